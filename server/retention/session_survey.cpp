// SPDX-License-Identifier: Apache-2.0
#include "server/retention/session_survey.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <optional>
#include <string_view>
#include <system_error>

#include "common/journal/journal.hpp"
#include "common/wire.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using std::chrono::steady_clock;
using std::chrono::system_clock;

constexpr std::string_view kSetAside = ".removed-";

/// Nothing if there is no such file.
std::optional<struct stat> status_of(const fs::path& path) {
  struct stat status {};
  if (::lstat(path.c_str(), &status) != 0) return std::nullopt;
  return status;
}

std::uint64_t bytes_on_disk(const struct stat& status) {
  constexpr std::uint64_t kBlock = 512;  // stat(2)'s, whatever the file system's
  return static_cast<std::uint64_t>(status.st_blocks) * kBlock;
}

system_clock::time_point last_write(const struct stat& status) {
  const auto since = std::chrono::seconds(status.st_mtim.tv_sec) +
                     std::chrono::nanoseconds(status.st_mtim.tv_nsec);
  return system_clock::time_point(std::chrono::duration_cast<system_clock::duration>(since));
}

bool has_journal(const fs::path& folder) {
  const auto segments = journal::segments_in(folder);
  return segments && !segments.value().empty();
}

/// Of all images, as far as the journal tells.
std::uint64_t bytes_of_images(const fs::path& folder) {
  constexpr std::uint64_t kHalfBlock = 2048;
  const auto summary = read_summary(folder);
  if (!summary) return 0;
  const auto& totals = summary->totals;
  return totals.image_bytes +
         (summary->has_removed() ? 0 : (totals.live + totals.late) * kHalfBlock);
}

}  // namespace

void SessionSurvey::begin() {
  set_aside_.clear();
  std::set<Key> found;
  std::error_code failed;  // what cannot be listed is not there
  for (fs::directory_iterator robot(path_, failed); !failed && robot != fs::directory_iterator();
       robot.increment(failed)) {
    if (wire::is_valid_id(robot->path().filename().string())) list_robot(robot->path(), found);
  }
  std::erase_if(measured_, [&](const auto& known) { return !found.contains(known.first); });
  to_measure_ = std::move(found);
}

void SessionSurvey::list_robot(const fs::path& robot, std::set<Key>& found) {
  std::error_code failed;
  for (fs::directory_iterator entry(robot, failed); !failed && entry != fs::directory_iterator();
       entry.increment(failed)) {
    const auto status = status_of(entry->path());
    if (!status || !S_ISDIR(status->st_mode)) continue;
    const std::string name = entry->path().filename().string();
    if (name.starts_with(kSetAside)) {
      set_aside_.push_back(entry->path());
    } else if (wire::is_valid_id(name) && has_journal(entry->path())) {
      found.emplace(robot.filename().string(), name);
    }
  }
}

bool SessionSurvey::go_on(steady_clock::time_point deadline) {
  while (!to_measure_.empty()) {
    const Key key = *to_measure_.begin();
    to_measure_.erase(to_measure_.begin());
    Measured& measured = measured_[key];
    measured.session.robot_id = key.first;
    measured.session.session_id = key.second;
    measure(path_ / key.first / key.second, measured);
    if (steady_clock::now() >= deadline) break;
  }
  return to_measure_.empty();
}

void SessionSurvey::measure(const fs::path& folder, Measured& measured) {
  std::uint64_t bytes = 0;
  system_clock::time_point written;
  std::error_code failed;
  for (fs::directory_iterator entry(folder, failed); !failed && entry != fs::directory_iterator();
       entry.increment(failed)) {
    const auto status = status_of(entry->path());
    if (!status) continue;
    bytes += bytes_on_disk(*status);
    written = std::max(written, last_write(*status));
  }
  if (written != measured.session.last_write) measured.image_bytes = bytes_of_images(folder);
  measured.session.last_write = written;
  measured.session.bytes = bytes + measured.image_bytes;
}

std::vector<KeptSession> SessionSurvey::sessions() const {
  std::vector<KeptSession> sessions;
  for (const auto& [key, measured] : measured_) sessions.push_back(measured.session);
  return sessions;
}

fs::path set_aside_folder(const fs::path& robot, const std::string& session_id) {
  return robot / (std::string(kSetAside) + session_id);
}

}  // namespace orbbuf
