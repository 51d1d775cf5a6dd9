// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/stream_mutator.hpp"

#include <algorithm>
#include <span>

#include "common/byte_order.hpp"
#include "common/wire.hpp"

namespace orbbuf::test {
namespace {

using wire::kHeaderBytes;

/// Makes a message of the front of `stream` and returns what is left behind it.
std::span<std::uint8_t> seal_first(std::span<std::uint8_t> stream) {
  const std::size_t room = stream.size() - kHeaderBytes;
  const auto claimed = wire::load<std::uint32_t>(&stream[8]);
  const auto length = static_cast<std::uint32_t>(std::min<std::size_t>(claimed, room));
  wire::store(stream.data(), wire::kMagic);
  stream[4] = wire::kHeaderFormat;
  stream[6] = stream[7] = 0;
  wire::store(&stream[8], length);
  wire::store(&stream[12], wire::crc32(stream.subspan(kHeaderBytes, length)));
  wire::store(&stream[16], wire::crc32(stream.first(16)));
  return stream.subspan(kHeaderBytes + length);
}

}  // namespace

std::size_t mutate_stream(std::uint8_t* data, std::size_t size, std::size_t max_size,
                          std::size_t offset, unsigned seed) {
  const std::size_t mutated = LLVMFuzzerMutate(data, size, max_size);
  if (seed % 16 == 0 || mutated <= offset) return mutated;
  auto rest = std::span(data, mutated).subspan(offset);
  while (rest.size() >= kHeaderBytes) rest = seal_first(rest);
  return mutated;
}

}  // namespace orbbuf::test
