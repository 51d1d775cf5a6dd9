// SPDX-License-Identifier: Apache-2.0
#include "server/retention/session_survey.hpp"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <optional>
#include <string_view>
#include <system_error>

#include "common/unique_fd.hpp"
#include "common/wire.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

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

bool is_session(const fs::path& folder) {
  const std::string recording = session_names::recording(folder.filename().string());
  return status_of(folder / session_names::kTimes) || status_of(folder / session_names::kDrops) ||
         status_of(folder / recording);
}

/// Both images of the frame that a line of times.txt names; those that are not there count nothing.
std::uint64_t bytes_of_images(const fs::path& folder, std::string_view line) {
  const auto times = session_lines::parse_times(line);
  if (!times) return 0;
  std::uint64_t bytes = 0;
  for (const auto& image :
       {session_names::left_image(times->sequence), session_names::right_image(times->sequence)}) {
    if (const auto status = status_of(folder / image)) bytes += bytes_on_disk(*status);
  }
  return bytes;
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
    } else if (wire::is_valid_id(name) && is_session(entry->path())) {
      found.emplace(robot.filename().string(), name);
    }
  }
}

bool SessionSurvey::go_on(steady_clock::time_point deadline) {
  while (!to_measure_.empty()) {
    const Key key = *to_measure_.begin();
    Measured& measured = measured_[key];
    measured.session.robot_id = key.first;
    measured.session.session_id = key.second;
    if (!measure(path_ / key.first / key.second, measured, deadline)) return false;
    to_measure_.erase(to_measure_.begin());
  }
  return true;
}

/// False: there is more to be read. Whatever is read counts, even of a pass that is given up.
bool SessionSurvey::measure(const fs::path& folder, Measured& measured,
                            steady_clock::time_point deadline) const {
  constexpr std::size_t kBlock = 4096;  // a hundred frames, a millisecond
  const UniqueFd times(::open((folder / session_names::kTimes).c_str(), O_RDONLY | O_CLOEXEC));
  std::array<char, kBlock> block;
  while (times) {
    const ssize_t got = ::pread(times.get(), block.data(), block.size(), measured.times_read);
    const std::string_view text(block.data(), static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    const auto end = text.rfind('\n');
    if (end == std::string_view::npos) break;
    std::string_view lines = text.substr(0, end + 1);
    measured.times_read += static_cast<off_t>(lines.size());
    for (; !lines.empty(); lines.remove_prefix(lines.find('\n') + 1)) {
      measured.image_bytes += bytes_of_images(folder, lines.substr(0, lines.find('\n')));
    }
    if (steady_clock::now() >= deadline) return false;
  }
  measured.session.bytes = measured.image_bytes;
  measured.session.last_write = {};
  std::error_code failed;
  for (fs::directory_iterator entry(folder, failed); !failed && entry != fs::directory_iterator();
       entry.increment(failed)) {
    const auto status = status_of(entry->path());
    if (!status) continue;
    measured.session.bytes += bytes_on_disk(*status);
    measured.session.last_write = std::max(measured.session.last_write, last_write(*status));
  }
  return true;
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
