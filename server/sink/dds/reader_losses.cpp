// SPDX-License-Identifier: Apache-2.0
#include "server/sink/dds/reader_losses.hpp"

#include <dds/dds.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <vector>

#include "common/dds/dds_participant.hpp"
#include "common/dds/reader_states.h"

namespace orbbuf {
namespace {

constexpr std::size_t kMostReaders = 64;

/// As ROS 2 has it.
std::string topic_of(dds_entity_t writer) {
  std::array<char, 256> name{};
  dds_get_name(dds_get_topic(writer), name.data(), name.size());
  const std::string text(name.data());
  return text.starts_with("rt/") ? text.substr(2) : text;
}

}  // namespace

void ReaderLosses::look(int participant) {
  Readers seen;
  for (const int writer : writers_of(participant)) look_at(writer, seen);
  readers_ = std::move(seen);  // without those that have gone
}

void ReaderLosses::look_at(int writer, Readers& seen) {
  std::array<orbbuf_reader_state, kMostReaders> states{};
  std::uint64_t kept_from = 0;
  const std::size_t count = orbbuf_reader_states(writer, states.data(), states.size(), &kept_from);
  for (std::size_t i = 0; i < count; ++i) {
    Guid guid;
    std::ranges::copy(states[i].guid, guid.begin());
    const auto known = readers_.find({writer, guid});
    const std::uint64_t has = states[i].acknowledged;
    const std::uint64_t gone = std::max<std::uint64_t>(kept_from, 1) - 1;
    Reader reader = known == readers_.end() ? Reader{std::max(has, gone)} : known->second;
    reader.gone = std::max(reader.gone, has);
    if (gone > reader.gone) reader.missed += gone - reader.gone;
    reader.gone = std::max(reader.gone, gone);
    if (reader.missed > reader.logged && reader.limit.lets_through()) {
      reader.logged = reader.missed;
      log_warn(
          "dds: a reader of {} has missed {} messages so far: it is slow, or has stopped ({:02x})",
          topic_of(writer), reader.missed, fmt::join(guid, "."));
    }
    seen.emplace(std::pair(writer, guid), reader);
  }
}

}  // namespace orbbuf
