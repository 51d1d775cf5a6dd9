// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/wire.hpp"

/// The fleet's keys and their values (JSON); docs/fleet.md has them for people. What cannot be read
/// is nothing: a newer server may write what an older one does not know.
namespace orbbuf::fleet {

inline constexpr std::string_view kServers = "/orbbuf/server/";
inline constexpr std::string_view kSessions = "/orbbuf/session/";
inline constexpr std::string_view kPositions = "/orbbuf/position/";

/// A robot's session.
struct SessionName {
  std::string robot_id;
  std::string session_id;

  std::string text() const { return robot_id + "/" + session_id; }
  std::string owner_key() const { return std::string(kSessions) + text(); }
  std::string position_key() const { return std::string(kPositions) + text(); }
  friend bool operator==(const SessionName&, const SessionName&) = default;
};
/// Of a session's or position's key.
std::optional<SessionName> session_of(std::string_view key);

/// A part of a session that one server has recorded, in a folder of its own.
struct Segment {
  std::string server;
  std::uint64_t epoch = 0;  ///< in which it began; 1: the first of the session
  wire::Position from;      ///< where it began

  friend bool operator==(const Segment&, const Segment&) = default;
};
/// Below the robot's folder: `SESSION`, or, of a later segment, `SESSION.e1795748706123`.
std::string folder_of(const std::string& session_id, const Segment& segment);
/// The session of such a folder, and the epoch; 1 without an ending.
struct SegmentFolder {
  std::string session_id;
  std::uint64_t epoch = 1;
};
SegmentFolder parse_folder(const std::string& folder);

/// Who may acknowledge. Each take-over raises the epoch; each start of a server is an instance.
struct SessionOwner {
  std::string server;
  std::string instance;
  std::uint64_t epoch = 0;
  std::vector<Segment> segments;  ///< at least one; the last is the owner's
  bool has_ended = false;         ///< the robot said so, and all is recorded

  friend bool operator==(const SessionOwner&, const SessionOwner&) = default;
};
std::string to_text(const SessionOwner& owner);
std::optional<SessionOwner> owner_from(std::string_view text);

std::string to_text(const wire::Position& position);
std::optional<wire::Position> position_from(std::string_view text);

/// A server that lives: its key goes with its lease.
struct ServerEntry {
  std::string name;
  std::string instance;
  std::string address;  ///< for robots
  std::string http;     ///< empty: it has no page
  std::uint64_t robots = 0;
  bool is_draining = false;
  std::string place{};  ///< names the folder that only one process at a time has, on its machine

  std::string key() const { return std::string(kServers) + name; }
  friend bool operator==(const ServerEntry&, const ServerEntry&) = default;
};
std::string to_text(const ServerEntry& server);
/// `key`: for the name.
std::optional<ServerEntry> server_from(std::string_view key, std::string_view text);

}  // namespace orbbuf::fleet
