// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fleet_keys.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/decimal.hpp"

namespace orbbuf::fleet {
namespace {

using nlohmann::json;

constexpr std::string_view kEpochMark = ".e";

/// The next number of each stream, as far as there are any.
json to_json(const wire::Position& position) {
  std::vector<std::uint64_t> next;
  for (wire::StreamId id = 0; id < wire::kMostStreams; ++id) next.push_back(position[id]);
  while (!next.empty() && next.back() == 0) next.pop_back();
  return {{"next", next}};
}

/// Throws json's exceptions, as do those below.
wire::Position position_of(const json& object) {
  wire::Position position;
  const auto next = object.at("next").get<std::vector<std::uint64_t>>();
  for (wire::StreamId id = 0; id < std::min(next.size(), wire::kMostStreams); ++id) {
    position[id] = next[id];
  }
  return position;
}

template <class Read>
auto read_json(std::string_view text, Read read) -> std::optional<decltype(read(json()))> {
  try {
    return read(json::parse(text));
  } catch (const json::exception&) {
    return std::nullopt;
  }
}

}  // namespace

std::optional<SessionName> session_of(std::string_view key) {
  for (const std::string_view prefix : {kSessions, kPositions}) {
    if (!key.starts_with(prefix)) continue;
    key.remove_prefix(prefix.size());
    const auto slash = key.find('/');
    if (slash == std::string_view::npos) return std::nullopt;
    SessionName name{std::string(key.substr(0, slash)), std::string(key.substr(slash + 1))};
    if (!wire::is_valid_id(name.robot_id) || !wire::is_valid_id(name.session_id)) {
      return std::nullopt;
    }
    return name;
  }
  return std::nullopt;
}

std::string folder_of(const std::string& session_id, const Segment& segment) {
  if (segment.epoch == 1) return session_id;
  return fmt::format("{}{}{}", session_id, kEpochMark, segment.epoch);
}

SegmentFolder parse_folder(const std::string& folder) {
  const auto mark = folder.rfind(kEpochMark);
  if (mark == std::string::npos || mark == 0) return {folder};
  const auto epoch = parse_digits(std::string_view(folder).substr(mark + kEpochMark.size()));
  if (!epoch || *epoch < 2) return {folder};
  return {folder.substr(0, mark), *epoch};
}

std::string to_text(const SessionOwner& owner) {
  json segments = json::array();
  for (const Segment& segment : owner.segments) {
    json entry = to_json(segment.from);
    entry["server"] = segment.server;
    entry["epoch"] = segment.epoch;
    segments.push_back(entry);
  }
  return json{{"server", owner.server},
              {"instance", owner.instance},
              {"epoch", owner.epoch},
              {"segments", segments},
              {"ended", owner.has_ended}}
      .dump();
}

std::optional<SessionOwner> owner_from(std::string_view text) {
  auto owner = read_json(text, [](const json& object) {
    SessionOwner read;
    read.server = object.at("server").get<std::string>();
    read.instance = object.at("instance").get<std::string>();
    read.epoch = object.at("epoch").get<std::uint64_t>();
    read.has_ended = object.value("ended", false);
    for (const json& entry : object.at("segments")) {
      read.segments.push_back({entry.at("server").get<std::string>(),
                               entry.at("epoch").get<std::uint64_t>(), position_of(entry)});
    }
    return read;
  });
  if (owner && owner->segments.empty()) owner.reset();
  return owner;
}

std::string to_text(const wire::Position& position) { return to_json(position).dump(); }

std::optional<wire::Position> position_from(std::string_view text) {
  return read_json(text, [](const json& object) { return position_of(object); });
}

std::string to_text(const ServerEntry& server) {
  return json{
      {"instance", server.instance}, {"address", server.address},      {"http", server.http},
      {"robots", server.robots},     {"draining", server.is_draining}, {"place", server.place}}
      .dump();
}

std::optional<ServerEntry> server_from(std::string_view key, std::string_view text) {
  if (!key.starts_with(kServers)) return std::nullopt;
  key.remove_prefix(kServers.size());
  return read_json(text, [key](const json& object) {
    return ServerEntry{std::string(key),
                       object.at("instance").get<std::string>(),
                       object.at("address").get<std::string>(),
                       object.value("http", ""),
                       object.value("robots", std::uint64_t{0}),
                       object.value("draining", false),
                       object.value("place", "")};
  });
}

}  // namespace orbbuf::fleet
