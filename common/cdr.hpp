// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

namespace orbbuf {

/// Writes a message of DDS (CDR, as ROS 2 has it): little-endian, each number aligned to its size,
/// behind the four bytes that say so.
class Cdr {
 public:
  template <class Number>
  requires std::integral<Number> || std::floating_point<Number>
  void put(Number value) {
    bytes_.resize(kHead + (bytes_.size() - kHead + sizeof value - 1) / sizeof value * sizeof value);
    append(&value, sizeof value);
  }
  void put(std::string_view text) {
    put(static_cast<std::uint32_t>(text.size() + 1));
    append(text.data(), text.size());
    bytes_.push_back(0);
  }
  void put(std::span<const std::uint8_t> sequence) {
    put(static_cast<std::uint32_t>(sequence.size()));
    put_array(sequence);
  }
  void put(std::span<const double> numbers) {
    for (const double number : numbers) put(number);
  }
  /// Of a fixed length, which is not written.
  void put_array(std::span<const std::uint8_t> octets) { append(octets.data(), octets.size()); }

  std::vector<std::uint8_t> take() { return std::move(bytes_); }

 private:
  static constexpr std::size_t kHead = 4;

  void append(const void* data, std::size_t size) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + size);
    if (size > 0) std::memcpy(bytes_.data() + at, data, size);
  }

  std::vector<std::uint8_t> bytes_{0, 1, 0, 0};
};

}  // namespace orbbuf
