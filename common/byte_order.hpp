// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <bit>
#include <boost/endian/conversion.hpp>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

/// Integers and texts as bytes in network order, for wire*.cpp and journals only. Writer and Reader
/// both have fields(), flags(), list(), rest() and require(): a template of the two names the
/// fields of a format once, as `fields(archive, FieldsOf<Archive, T>& value)`.
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

  /// An integer, an enumerator or a double as it is, a bool as a u8, a text as put_text() does.
  template <class T>
  void put(const T& value) {
    if constexpr (std::is_enum_v<T>) {
      put(static_cast<std::underlying_type_t<T>>(value));
    } else if constexpr (std::is_same_v<T, bool>) {
      put(std::uint8_t{value});
    } else if constexpr (std::is_same_v<T, double>) {
      put(std::bit_cast<std::uint64_t>(value));
    } else if constexpr (std::integral<T>) {
      bytes_.resize(bytes_.size() + sizeof(T));
      store(bytes_.data() + bytes_.size() - sizeof(T), value);
    } else {
      put_text(value);
    }
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

  template <class... Values>
  void fields(const Values&... values) {
    (put(values), ...);
  }
  /// A u8 with a bit for each, the first in the lowest.
  template <class... Flags>
  void flags(const Flags&... flags) {
    unsigned bit = 0;
    unsigned all = 0;
    ((all |= unsigned{flags} << bit++), ...);
    put(static_cast<std::uint8_t>(all));
  }
  /// u32 count, then each by `put_item`.
  template <class List, class PutItem>
  void list(const List& list, PutItem put_item) {
    put(static_cast<std::uint32_t>(list.size()));
    for (const auto& item : list) put_item(item);
  }
  /// All that follows.
  void rest(std::span<const std::uint8_t> bytes) { put_bytes(bytes); }
  void require(bool /*is_so*/) {}

  std::vector<std::uint8_t>& bytes() { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_;
};

/// Takes what a Writer put, in the same order. Past the end it yields zeros and is_short() from
/// then on, so that a parser need look only once, after its last take.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : rest_(bytes) {}

  /// What Writer::put() takes. An enumerator may have any value.
  template <class T>
  T take() {
    if constexpr (std::is_enum_v<T>) {
      return static_cast<T>(take<std::underlying_type_t<T>>());
    } else if constexpr (std::is_same_v<T, bool>) {
      return take<std::uint8_t>() != 0;
    } else if constexpr (std::is_same_v<T, double>) {
      return std::bit_cast<double>(take<std::uint64_t>());
    } else if constexpr (std::integral<T>) {
      const auto bytes = take_bytes(sizeof(T));
      return bytes.empty() ? T{0} : load<T>(bytes.data());
    } else {
      return T(take_text());
    }
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
    require(count <= rest_.size());
    if (is_short_) return {};
    const auto bytes = rest_.first(count);
    rest_ = rest_.subspan(count);
    return bytes;
  }

  template <class... Values>
  void fields(Values&... values) {
    ((values = take<Values>()), ...);
  }
  template <class... Flags>
  void flags(Flags&... flags) {
    unsigned all = take<std::uint8_t>();
    ((flags = (std::exchange(all, all / 2) & 1U) != 0), ...);
  }
  template <class Item, class TakeItem>
  void list(std::vector<Item>& list, TakeItem take_item) {
    for (auto count = take<std::uint32_t>(); count > 0 && !is_short_; --count) {
      take_item(list.emplace_back());
    }
  }
  void rest(std::vector<std::uint8_t>& bytes) {
    const auto all = take_bytes(rest_.size());
    bytes.assign(all.begin(), all.end());
  }
  /// Otherwise it goes on as past the end.
  void require(bool is_so) {
    if (is_so) return;
    is_short_ = true;
    rest_ = {};
  }

  bool is_short() const { return is_short_; }
  std::size_t left() const { return rest_.size(); }

 private:
  std::span<const std::uint8_t> rest_;
  bool is_short_ = false;
};

/// What a list of fields is given: a Reader changes the value.
template <class Archive, class T>
using FieldsOf = std::conditional_t<std::is_same_v<Archive, Reader>, T, const T>;

}  // namespace orbbuf::wire
