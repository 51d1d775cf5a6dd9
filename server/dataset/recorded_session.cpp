// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/recorded_session.hpp"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <functional>
#include <optional>
#include <string_view>
#include <utility>

#include "common/log.hpp"
#include "server/dataset/read_file.hpp"
#include "server/sink/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

/// A file that is not there is empty.
Result<std::string> read_text(const fs::path& path) {
  std::error_code ignored;  // then reading says why
  if (!fs::exists(path, ignored) && !ignored) return std::string();
  return read_file(path);
}

/// Hands each line of `text` to `take`, which says whether it could read it.
void for_each_line(const char* name, std::string_view text,
                   const std::function<bool(std::string_view)>& take,
                   std::vector<std::string>& problems) {
  for (std::size_t number = 1; !text.empty(); ++number) {
    const auto end = text.find('\n');
    const auto line = text.substr(0, end);
    if (end == std::string_view::npos) {
      problems.push_back(
          fmt::format("{}:{}: torn, \"{}\"", name, number, printable(std::string(line))));
      return;
    }
    if (!take(line)) {
      problems.push_back(
          fmt::format("{}:{}: cannot be read, \"{}\"", name, number, printable(std::string(line))));
    }
    text.remove_prefix(end + 1);
  }
}

template <class Number>
bool parse_whole(std::string_view text, Number& number, int base = 10) {
  const char* const end = text.data() + text.size();
  const auto [stop, failed] = std::from_chars(text.data(), end, number, base);
  return failed == std::errc{} && stop == end;
}

bool is_decimal(std::string_view text) {
  return !text.empty() && text.find_first_not_of("0123456789.") == std::string_view::npos;
}

/// SEQUENCE SECONDS EXPOSURE.
std::optional<RecordedFrame> parse_frame(std::string_view line) {
  const auto first = line.find(' ');
  const auto second = line.rfind(' ');
  if (first == second) return std::nullopt;
  RecordedFrame frame;
  const auto time = parse_seconds(line.substr(first + 1, second - first - 1));
  if (!parse_whole(line.substr(0, first), frame.sequence) || !time) return std::nullopt;
  frame.capture_time_ns = *time;
  frame.exposure_ms = line.substr(second + 1);
  if (!is_decimal(frame.exposure_ms)) return std::nullopt;
  return frame;
}

void parse_times(std::string_view text, RecordedSession& session) {
  const auto take = [&](std::string_view line) {
    auto frame = parse_frame(line);
    if (frame) session.frames.push_back(std::move(*frame));
    return frame.has_value();
  };
  for_each_line(session_names::kTimes, text, take, session.problems);
}

void parse_drops(std::string_view text, RecordedSession& session) {
  bool is_first = true;
  const auto take = [&](std::string_view line) {
    if (std::exchange(is_first, false)) return line == kDropCsvHeader;
    const auto drop = drop_from_csv(line);
    if (drop) session.drops.push_back(*drop);
    return drop.has_value();
  };
  for_each_line(session_names::kDrops, text, take, session.problems);
}

/// IMAGE CRC, of two lines for one image the last.
void parse_checksums(std::string_view text, RecordedSession& session) {
  constexpr std::size_t kDigits = 8;
  const auto take = [&](std::string_view line) {
    const auto blank = line.rfind(' ');
    if (blank == std::string_view::npos || line.size() - blank - 1 != kDigits) return false;
    std::uint32_t crc = 0;
    if (!parse_whole(line.substr(blank + 1), crc, 16)) return false;
    session.checksums.insert_or_assign(std::string(line.substr(0, blank)), crc);
    return true;
  };
  for_each_line(session_names::kChecksums, text, take, session.problems);
}

}  // namespace

Result<RecordedSession> read_recorded_session(const fs::path& folder) {
  std::error_code ignored;  // what is not there is no session
  if (!fs::exists(folder / session_names::kTimes, ignored) &&
      !fs::exists(folder / session_names::kDrops, ignored)) {
    return Error{folder.string() + ": not a session: neither times.txt nor drops.csv in it"};
  }
  RecordedSession session;
  session.folder = folder;
  session.is_stereo = fs::exists(folder / session_names::kRightImages, ignored);
  auto times = read_text(folder / session_names::kTimes);
  if (!times) return std::move(times).error();
  auto drops = read_text(folder / session_names::kDrops);
  if (!drops) return std::move(drops).error();
  auto calibration = read_text(folder / session_names::kCamera);
  if (!calibration) return std::move(calibration).error();
  auto checksums = read_text(folder / session_names::kChecksums);
  if (!checksums) return std::move(checksums).error();
  parse_times(times.value(), session);
  parse_drops(drops.value(), session);
  parse_checksums(checksums.value(), session);
  session.calibration = std::move(calibration).value();
  return session;
}

std::vector<std::string> problems_of_order(const RecordedSession& session) {
  std::vector<std::string> problems;
  for (std::size_t i = 1; i < session.frames.size(); ++i) {
    const RecordedFrame& before = session.frames[i - 1];
    const RecordedFrame& frame = session.frames[i];
    if (frame.sequence <= before.sequence) {
      problems.push_back(fmt::format("{}: frame {} comes after frame {}", session_names::kTimes,
                                     frame.sequence, before.sequence));
    } else if (frame.capture_time_ns <= before.capture_time_ns) {
      problems.push_back(fmt::format("{}: frame {} was taken at {} s, not after frame {} at {} s",
                                     session_names::kTimes, frame.sequence,
                                     format_seconds(frame.capture_time_ns), before.sequence,
                                     format_seconds(before.capture_time_ns)));
    }
  }
  return problems;
}

}  // namespace orbbuf
