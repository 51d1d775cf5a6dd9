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
         status_of(folder / session_names::kLateList) || status_of(folder / recording);
}

/// Both of a frame; those that are not there count nothing.
std::uint64_t bytes_of_images(const fs::path& folder, Sequence sequence) {
  std::uint64_t bytes = 0;
  for (const auto& image :
       {session_names::left_image(sequence), session_names::right_image(sequence)}) {
    if (const auto status = status_of(folder / image)) bytes += bytes_on_disk(*status);
  }
  return bytes;
}

/// Of the frame that a line of times.txt names.
std::uint64_t bytes_of_live(const fs::path& folder, std::string_view line) {
  const auto times = session_lines::parse_times(line);
  return times ? bytes_of_images(folder, times->sequence) : 0;
}

/// Of the frame that a line of late.csv names, until it is merged.
std::uint64_t bytes_of_late(const fs::path& folder, std::string_view line) {
  const auto late = session_lines::parse_late(line);
  return late ? bytes_of_images(folder / session_names::kLate, late->sequence) : 0;
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
bool SessionSurvey::measure_list(const fs::path& folder, const char* list, BytesOf bytes_of,
                                 ListedImages& images, steady_clock::time_point deadline) {
  constexpr std::size_t kBlock = 4096;  // a hundred frames, a millisecond
  const UniqueFd file(::open((folder / list).c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status {};
  if (!file || ::fstat(file.get(), &status) != 0) return true;
  const bool is_same = status.st_ino == images.file && status.st_size >= images.read;
  if (!is_same) images = {status.st_ino, 0, 0};
  std::array<char, kBlock> block;
  for (;;) {
    const ssize_t got = ::pread(file.get(), block.data(), block.size(), images.read);
    const std::string_view text(block.data(), static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    const auto end = text.rfind('\n');
    if (end == std::string_view::npos) return true;
    std::string_view lines = text.substr(0, end + 1);
    images.read += static_cast<off_t>(lines.size());
    for (; !lines.empty(); lines.remove_prefix(lines.find('\n') + 1)) {
      images.bytes += bytes_of(folder, lines.substr(0, lines.find('\n')));
    }
    if (steady_clock::now() >= deadline) return false;
  }
}

bool SessionSurvey::measure(const fs::path& folder, Measured& measured,
                            steady_clock::time_point deadline) const {
  if (!measure_list(folder, session_names::kTimes, bytes_of_live, measured.live, deadline)) {
    return false;
  }
  if (!status_of(folder / session_names::kLate)) {
    measured.late = {};
  } else if (!measure_list(folder, session_names::kLateList, bytes_of_late, measured.late,
                           deadline)) {
    return false;
  }
  measured.session.bytes = measured.live.bytes + measured.late.bytes;
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
