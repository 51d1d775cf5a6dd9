// SPDX-License-Identifier: Apache-2.0
#include "common/crc32.hpp"

#include <zlib.h>

namespace orbbuf {

std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t seed) {
  // zlib takes a null pointer for a request of its initial value, whatever the seed.
  if (bytes.empty()) return seed;
  return static_cast<std::uint32_t>(::crc32_z(seed, bytes.data(), bytes.size()));
}

}  // namespace orbbuf
