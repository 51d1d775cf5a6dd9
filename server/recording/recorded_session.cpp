// SPDX-License-Identifier: Apache-2.0
#include "server/recording/recorded_session.hpp"

#include <spdlog/fmt/fmt.h>

#include <functional>
#include <optional>
#include <string_view>
#include <utility>

#include "common/decimal.hpp"
#include "common/log.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

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

bool is_decimal(std::string_view text) {
  return !text.empty() && text.find_first_not_of("0123456789.") == std::string_view::npos;
}

void parse_times(std::string_view text, RecordedSession& session) {
  const auto take = [&](std::string_view line) {
    const auto times = session_lines::parse_times(line);
    if (!times || !is_decimal(times->exposure_ms)) return false;
    session.frames.push_back(
        {times->sequence, times->capture_time_ns, std::string(times->exposure_ms)});
    return true;
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

/// Of two lines for one image the last counts.
void parse_checksums(std::string_view text, RecordedSession& session) {
  const auto take = [&](std::string_view line) {
    const auto checksum = session_lines::parse_checksum(line);
    if (checksum) session.checksums.insert_or_assign(std::string(checksum->image), checksum->crc);
    return checksum.has_value();
  };
  for_each_line(session_names::kChecksums, text, take, session.problems);
}

std::string why_no_session(const fs::path& folder) {
  const fs::path named = folder.has_filename() ? folder : folder.parent_path();
  const std::string recording = session_names::recording(named.filename().string());
  std::error_code ignored;  // then it is no session either
  return fs::exists(folder / recording, ignored)
             ? ": there is only " + recording + ", which is not read: [files] makes what is"
             : ": not a session: neither times.txt nor drops.csv in it";
}

}  // namespace

Result<RecordedSession> read_recorded_session(const fs::path& folder) {
  std::error_code ignored;  // what is not there is no session
  if (!fs::exists(folder / session_names::kTimes, ignored) &&
      !fs::exists(folder / session_names::kDrops, ignored)) {
    return Error{folder.string() + why_no_session(folder)};
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
  const auto end = read_text(folder / session_names::kEnd);
  if (!end) return end.error();
  auto checksums = read_text(folder / session_names::kChecksums);
  if (!checksums) return std::move(checksums).error();
  parse_times(times.value(), session);
  parse_drops(drops.value(), session);
  parse_checksums(checksums.value(), session);
  session.calibration = std::move(calibration).value();
  session.closing = closing_from_csv(end.value());
  if (!end.value().empty() && !session.closing) {
    session.problems.push_back(fmt::format("{}: cannot be read", session_names::kEnd));
  }
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
