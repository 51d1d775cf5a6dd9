// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
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
std::vector<KeptSession> over_quota(std::vector<KeptSession> sessions, const Quota& quota,
                                    std::chrono::system_clock::time_point now,
                                    const std::function<bool(const KeptSession&)>& is_finished);

}  // namespace orbbuf
