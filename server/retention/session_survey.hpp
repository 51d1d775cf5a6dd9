// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/retention/quota.hpp"

namespace orbbuf {

/// Finds out what the sessions below a folder, PATH/ROBOT/SESSION, take on the disk, a little at a
/// time. A folder without what a recording begins with is none, nor is a symbolic link. A session
/// is measured by the images that times.txt and late.csv name and the files beside it; of one that
/// was measured before only what is new, unless a merge of late frames has replaced the list, so
/// that a pass over what has not changed costs a few stat(2) a session. Blocking; thread-bound.
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
  /// The images that a list of frames names, as far as it was read.
  struct ListedImages {
    ino_t file = 0;
    off_t read = 0;  // bytes of the list
    std::uint64_t bytes = 0;
  };
  struct Measured {
    ListedImages live;
    ListedImages late;
    KeptSession session;
  };
  using BytesOf = std::uint64_t (*)(const std::filesystem::path& folder, std::string_view line);

  void list_robot(const std::filesystem::path& robot, std::set<Key>& found);
  static bool measure_list(const std::filesystem::path& folder, const char* list, BytesOf bytes_of,
                           ListedImages& images, std::chrono::steady_clock::time_point deadline);
  bool measure(const std::filesystem::path& folder, Measured& measured,
               std::chrono::steady_clock::time_point deadline) const;

  const std::filesystem::path path_;
  std::map<Key, Measured> measured_;
  std::set<Key> to_measure_;
  std::vector<std::filesystem::path> set_aside_;
};

/// What a session's folder is called from when it has to go until it has gone: no session's id.
std::filesystem::path set_aside_folder(const std::filesystem::path& robot,
                                       const std::string& session_id);

}  // namespace orbbuf
