// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <zlib.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

namespace orbbuf::bench {

using Message = std::vector<std::uint8_t>;

/// The next message that camera.py writes to standard input: the frame's number in 8 bytes, and the
/// JPEG. Ends the process at the end of the input.
inline Message next_message() {
  std::array<std::uint8_t, 4> head{};
  if (std::fread(head.data(), 1, head.size(), stdin) < head.size()) std::exit(EXIT_SUCCESS);
  std::size_t size = 0;
  for (const std::uint8_t byte : head) size = size << 8 | byte;
  Message message(size);
  if (std::fread(message.data(), 1, size, stdin) < size) std::exit(EXIT_SUCCESS);
  return message;
}

/// Prints the line NUMBER TIME CRC of a message that has arrived.
inline void print_arrival(const std::uint8_t* message, std::size_t size) {
  constexpr std::size_t kNumberBytes = 8;
  constexpr long long kPerSecond = 1'000'000;
  if (size < kNumberBytes) return;
  unsigned long long number = 0;
  for (std::size_t i = 0; i < kNumberBytes; ++i) number = number << 8 | message[i];
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto us =
      static_cast<long long>(std::chrono::duration_cast<std::chrono::microseconds>(now).count());
  const auto crc = ::crc32(0, message + kNumberBytes, static_cast<uInt>(size - kNumberBytes));
  std::printf("%llu %lld.%06lld %lu\n", number, us / kPerSecond, us % kPerSecond, crc);
  std::fflush(stdout);
}

}  // namespace orbbuf::bench
