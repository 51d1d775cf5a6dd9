// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <boost/endian/conversion.hpp>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// Integers and texts as bytes in network order, for wire*.cpp and journals only.
namespace orbbuf::wire {

/// Writes `value` to at[0 .. sizeof value), most significant byte first; returns the place after.
template <std::integral T>
std::uint8_t* store(std::uint8_t* at, T value) {
  boost::endian::endian_store<T, sizeof(T), boost::endian::order::big>(at, value);
  return at + sizeof(T);
}

/// The reverse of store().
template <std::integral T>
T load(const std::uint8_t* at) {
  return boost::endian::endian_load<T, sizeof(T), boost::endian::order::big>(at);
}

/// Appends to a byte vector.
class Writer {
 public:
  explicit Writer(std::size_t skip_bytes) : bytes_(skip_bytes) {}

  template <std::integral T>
  void put(T value) {
    bytes_.resize(bytes_.size() + sizeof(T));
    store(bytes_.data() + bytes_.size() - sizeof(T), value);
  }
  void put_zeros(std::size_t count) { bytes_.insert(bytes_.end(), count, 0); }
  /// u16 length, then the bytes. Requires text.size() < 64 Ki.
  void put_text(std::string_view text) {
    put(static_cast<std::uint16_t>(text.size()));
    bytes_.insert(bytes_.end(), text.begin(), text.end());
  }

  void put_bytes(std::span<const std::uint8_t> bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }

  std::vector<std::uint8_t>& bytes() { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_;
};

/// Takes what a Writer put, in the same order. Past the end it yields zeros and is_short() from
/// then on, so that a parser need look only once, after its last take.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : rest_(bytes) {}

  template <std::integral T>
  T take() {
    const auto bytes = take_bytes(sizeof(T));
    return bytes.empty() ? T{0} : load<T>(bytes.data());
  }
  /// A view into the bytes; not copied, so its length need not be trusted.
  std::string_view take_text() {
    const auto bytes = take_bytes(take<std::uint16_t>());
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }

  /// True if the next `count` bytes are there and all zero.
  bool take_zeros(std::size_t count) {
    const auto bytes = take_bytes(count);
    return !is_short_ &&
           std::all_of(bytes.begin(), bytes.end(), [](auto byte) { return byte == 0; });
  }

  /// A view, as take_text() gives it. Empty past the end.
  std::span<const std::uint8_t> take_bytes(std::size_t count) {
    if (count > rest_.size()) {
      is_short_ = true;
      rest_ = {};
      return {};
    }
    const auto bytes = rest_.first(count);
    rest_ = rest_.subspan(count);
    return bytes;
  }

  bool is_short() const { return is_short_; }
  std::size_t left() const { return rest_.size(); }

 private:
  std::span<const std::uint8_t> rest_;
  bool is_short_ = false;
};

}  // namespace orbbuf::wire
