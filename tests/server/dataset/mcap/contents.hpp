// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "testing/temporary_folder.hpp"

namespace orbbuf::test {

/// An MCAP file as one reads it from front to back, by https://mcap.dev/spec; tests/e2e/mcap.sh has
/// MCAP's own library read whole recordings.
struct McapContents {
  std::map<std::uint16_t, std::string> topics;                   ///< by channel
  std::map<std::uint16_t, std::vector<std::uint32_t>> messages;  ///< their numbers, by channel
  std::map<std::uint16_t, std::vector<std::string>> data;        ///< of these
  std::map<std::uint8_t, int> records;                           ///< by opcode, in chunks, too
  std::vector<std::pair<std::uint64_t, std::uint64_t>> chunk_times;

  /// Of that topic.
  std::vector<std::uint32_t> of(const std::string& topic) const {
    for (const auto& [channel, name] : topics) {
      if (name == topic && messages.contains(channel)) return messages.at(channel);
    }
    return {};
  }
  std::vector<std::string> data_of(const std::string& topic) const {
    for (const auto& [channel, name] : topics) {
      if (name == topic && data.contains(channel)) return data.at(channel);
    }
    return {};
  }
};

inline McapContents read_mcap(const std::filesystem::path& path) {
  constexpr std::string_view kMagic = "\x89MCAP0\r\n";
  constexpr std::size_t kPrefix = 9;
  McapContents contents;
  const std::string file = read_file(path);
  EXPECT_TRUE(file.starts_with(kMagic) && file.ends_with(kMagic));
  const auto number = [](std::string_view bytes, std::size_t at, auto value) {
    if (bytes.size() < at + sizeof value) return ADD_FAILURE() << "too short", value;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
  };
  const auto read = [&](std::string_view bytes, const auto& again) -> void {
    while (!bytes.empty()) {
      const auto opcode = number(bytes, 0, std::uint8_t{});
      const auto length = number(bytes, 1, std::uint64_t{});
      ASSERT_LE(length, bytes.size() - kPrefix);
      const auto fields = bytes.substr(kPrefix, length);
      bytes.remove_prefix(kPrefix + length);
      ++contents.records[opcode];
      if (opcode == 0x04) {
        const auto topic_bytes = number(fields, 4, std::uint32_t{});
        contents.topics[number(fields, 0, std::uint16_t{})] = fields.substr(8, topic_bytes);
      } else if (opcode == 0x05) {
        const auto channel = number(fields, 0, std::uint16_t{});
        contents.messages[channel].push_back(number(fields, 2, std::uint32_t{}));
        contents.data[channel].emplace_back(fields.substr(22));
      } else if (opcode == 0x06) {
        contents.chunk_times.emplace_back(number(fields, 0, std::uint64_t{}),
                                          number(fields, 8, std::uint64_t{}));
        again(fields.substr(40), again);
      }
    }
  };
  if (file.size() >= 2 * kMagic.size()) {
    const std::string_view all = file;
    read(all.substr(kMagic.size(), all.size() - 2 * kMagic.size()), read);
  }
  return contents;
}

}  // namespace orbbuf::test
