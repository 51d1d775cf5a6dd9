// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/drop_file.hpp"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <optional>
#include <string_view>
#include <system_error>
#include <tuple>
#include <utility>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kCaptured = "captured,";
constexpr std::string_view kConfirmed = ",confirmed,";
constexpr std::string_view kComment = "# ";
constexpr std::string_view kEnded = "# ended,";
/// More than the drop records that come within a second.
constexpr std::streamoff kTailBytes = 4 << 20;

/// Whether it is new_session_id() and ".csv": a folder of the user's may hold other files.
bool is_of_session(std::string_view name) {
  constexpr std::string_view kShape = "00000000T000000Z-xxxxxxxxxxxxxxxx.csv";
  const auto matches = [](char is, char shape) {
    const bool is_digit = is >= '0' && is <= '9';
    if (shape == '0') return is_digit;
    if (shape == 'x') return is_digit || (is >= 'a' && is <= 'f');
    return is == shape;
  };
  return std::equal(name.begin(), name.end(), kShape.begin(), kShape.end(), matches);
}

/// The files of other sessions, the newest first.
std::vector<fs::path> others(const fs::path& folder, const fs::path& own) {
  std::vector<std::pair<fs::file_time_type, fs::path>> found;
  std::error_code failed;
  for (fs::directory_iterator i(folder, failed), end; !failed && i != end; i.increment(failed)) {
    std::error_code gone;
    const fs::file_time_type time = i->last_write_time(gone);
    if (!gone && i->path() != own && is_of_session(i->path().filename().string())) {
      found.emplace_back(time, i->path());
    }
  }
  std::sort(found.rbegin(), found.rend());
  std::vector<fs::path> files;
  files.reserve(found.size());
  for (auto& file : found) files.push_back(std::move(file.second));
  return files;
}

/// The difference of the two numbers of counts(), behind kComment; nothing if `line` is not that.
std::optional<std::uint64_t> unconfirmed_in(std::string_view line) {
  const auto skip = [&line](std::string_view word) {
    const bool is_there = line.starts_with(word);
    if (is_there) line.remove_prefix(word.size());
    return is_there;
  };
  const auto number = [&line](std::uint64_t& value) {
    const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), value);
    line.remove_prefix(static_cast<std::size_t>(end - line.data()));
    return error == std::errc();
  };
  std::uint64_t captured = 0;
  std::uint64_t confirmed = 0;
  if (!skip(kComment) || !skip(kCaptured) || !number(captured) || !skip(kConfirmed) ||
      !number(confirmed) || !line.empty() || confirmed > captured) {
    return std::nullopt;
  }
  return captured - confirmed;
}

void tell_unless_ended(const fs::path& path) {
  std::ifstream file(path, std::ios::ate);
  if (!file) return;
  file.seekg(std::max<std::streamoff>(0, static_cast<std::streamoff>(file.tellg()) - kTailBytes));
  std::optional<std::uint64_t> unconfirmed;
  std::string line;
  while (std::getline(file, line) && !file.eof()) {  // a line without its end was cut
    if (line.starts_with(kEnded)) return;
    if (const auto count = unconfirmed_in(line)) unconfirmed = count;
  }
  spdlog::warn(
      "session {} did not end in order; when last counted, {} frames were captured and "
      "not confirmed: {}",
      path.stem().string(), unconfirmed ? std::to_string(*unconfirmed) : "an unknown number of",
      path.string());
}

}  // namespace

DropFile::DropFile(const fs::path& folder, const std::string& session_id) {
  if (folder.empty()) return;
  path_ = folder / (session_id + ".csv");
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed) {
    give_up(failed.value());
    return;
  }
  const std::vector<fs::path> files = others(folder, path_);
  if (!files.empty()) tell_unless_ended(files.front());
  for (std::size_t i = kMostFiles - 1; i < files.size(); ++i) fs::remove(files[i], failed);
  file_.open(path_, std::ios::app);
  file_ << kDropCsvHeader << '\n';
  flush();
}

void DropFile::flush() {
  if (!file_.flush()) give_up(errno);
}

void DropFile::give_up(int error) {
  spdlog::warn("{}; the stream goes on without it",
               system_error("cannot write the drop log " + path_.string(), error).text);
  file_.close();
}

void DropFile::add(std::span<const DropRecord> records) {
  if (records.empty() || !file_.is_open()) return;
  for (const DropRecord& record : records) file_ << to_csv(record) << '\n';
  named_ += records.size();
  flush();
}

std::string DropFile::counts(const wire::Stats& stats) const {
  return fmt::format("{}{}{}{}", kCaptured, stats.captured, kConfirmed,
                     stats.acknowledged + named_);
}

void DropFile::note(const wire::Stats& stats) {
  std::string line = counts(stats);
  if (!file_.is_open() || line == noted_) return;
  file_ << kComment << line << '\n';
  noted_ = std::move(line);
  flush();
}

void DropFile::end(const wire::Stats& stats) {
  if (!file_.is_open()) return;
  file_ << kEnded << counts(stats) << '\n';
  flush();
  file_.close();
  std::error_code failed;
  if (stats.captured == 0) fs::remove(path_, failed);
}

}  // namespace orbbuf
