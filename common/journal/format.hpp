// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "common/byte_order.hpp"
#include "common/crc32.hpp"
#include "common/journal/journal.hpp"

/// The head of a record (journal.hpp), for reader.cpp and writer.cpp.
namespace orbbuf::journal {

inline constexpr std::uint32_t kMagic = 0x4F424A52;  // "OBJR"

struct Head {
  std::uint32_t body_bytes = 0;
  std::uint8_t type = 0;
  std::uint32_t crc = 0;
  std::uint32_t head_crc = 0;  ///< that the body's continues
};

inline std::uint32_t head_crc(std::span<const std::uint8_t> head) {
  return crc32(head.subspan(4, 5));
}

/// Nothing: it is no head, or not the whole of it.
inline std::optional<Head> parse_head(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < kHeadBytes || wire::load<std::uint32_t>(bytes.data()) != kMagic) {
    return std::nullopt;
  }
  const Head head{wire::load<std::uint32_t>(&bytes[4]), bytes[8],
                  wire::load<std::uint32_t>(&bytes[9]), head_crc(bytes)};
  if (head.body_bytes > kMostBodyBytes) return std::nullopt;
  return head;
}

/// Fills in the first kHeadBytes of `record`, whose body follows them.
inline void store_head(std::uint8_t type, std::span<std::uint8_t> record) {
  const auto body = record.subspan(kHeadBytes);
  wire::store(record.data(), kMagic);
  wire::store(&record[4], static_cast<std::uint32_t>(body.size()));
  record[8] = type;
  wire::store(&record[9], crc32(body, head_crc(record)));
}

}  // namespace orbbuf::journal
