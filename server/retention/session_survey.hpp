// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/retention/quota.hpp"

namespace orbbuf {

/// Finds out what the sessions below a folder, PATH/ROBOT/SESSION, take on the disk, a little at a
/// time. A folder without a journal is none, nor is a symbolic link. Images are not looked at one
/// by one: their bytes are in the newest segment of the journal, which is read if something was
/// written since the last pass, and each takes half a block more; the files beside it, orphans/
/// left out, count as they are. So a pass over what has not changed costs a few stat(2) a session.
/// Blocking; thread-bound.
class SessionSurvey {
 public:
  explicit SessionSurvey(std::filesystem::path path) : path_(std::move(path)) {}

  /// A new pass: lists the sessions, and the folders that were set aside and never removed.
  void begin();
  /// Goes on until `deadline`, by and large. True: the pass is over.
  bool go_on(std::chrono::steady_clock::time_point deadline);

  /// What the pass has found.
  std::vector<KeptSession> sessions() const;
  const std::vector<std::filesystem::path>& set_aside_folders() const { return set_aside_; }

 private:
  using Key = std::pair<std::string, std::string>;  // robot id, session id
  struct Measured {
    std::uint64_t image_bytes = 0;  // when the session was last written to
    KeptSession session;
  };

  void list_robot(const std::filesystem::path& robot, std::set<Key>& found);
  static void measure(const std::filesystem::path& folder, Measured& measured);

  const std::filesystem::path path_;
  std::map<Key, Measured> measured_;
  std::set<Key> to_measure_;
  std::vector<std::filesystem::path> set_aside_;
};

/// What a session's folder is called from when it has to go until it has gone: no session's id.
std::filesystem::path set_aside_folder(const std::filesystem::path& robot,
                                       const std::string& session_id);

}  // namespace orbbuf
