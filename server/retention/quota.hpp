// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <tuple>
#include <vector>

namespace orbbuf {

/// How much is kept of each robot's sessions.
struct Quota {
  std::uint64_t bytes = 0;          ///< on the disk, all sessions together; 0: no limit
  std::chrono::nanoseconds age{0};  ///< since the last write; 0: no limit

  bool is_set() const { return bytes > 0 || age.count() > 0; }

  friend bool operator==(const Quota&, const Quota&) = default;
};

/// A session as the disk has it.
struct KeptSession {
  std::string robot_id;
  std::string session_id;
  std::uint64_t bytes = 0;  ///< that its files take on the disk
  std::chrono::system_clock::time_point last_write;
};

/// Which of one robot's sessions have to go, the oldest first. `is_finished` says of which it is
/// allowed. By size, the newest one always stays, whatever its size: it is what the robot was
/// started for last.
inline std::vector<KeptSession> over_quota(
    std::vector<KeptSession> sessions, const Quota& quota,
    std::chrono::system_clock::time_point now,
    const std::function<bool(const KeptSession&)>& is_finished) {
  std::ranges::sort(sessions, [](const KeptSession& a, const KeptSession& b) {
    return std::tie(a.last_write, a.session_id) < std::tie(b.last_write, b.session_id);
  });
  std::uint64_t bytes = 0;
  for (const KeptSession& session : sessions) bytes += session.bytes;
  std::vector<KeptSession> going;
  for (std::size_t i = 0; i < sessions.size(); ++i) {
    const bool is_newest = i + 1 == sessions.size();
    const bool is_too_old = quota.age.count() > 0 && now - sessions[i].last_write > quota.age;
    const bool is_too_much = quota.bytes > 0 && bytes > quota.bytes && !is_newest;
    if ((!is_too_old && !is_too_much) || !is_finished(sessions[i])) continue;
    bytes -= sessions[i].bytes;
    going.push_back(sessions[i]);
  }
  return going;
}

}  // namespace orbbuf
