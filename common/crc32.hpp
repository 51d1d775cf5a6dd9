// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <zlib.h>

#include <cstdint>
#include <span>

namespace orbbuf {

/// zlib's CRC-32, continued from `seed`, the CRC of what came before.
inline std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t seed = 0) {
  // zlib takes a null pointer for a request of its initial value, whatever the seed.
  if (bytes.empty()) return seed;
  return static_cast<std::uint32_t>(::crc32_z(seed, bytes.data(), bytes.size()));
}

}  // namespace orbbuf
