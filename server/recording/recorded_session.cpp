// SPDX-License-Identifier: Apache-2.0
#include "server/recording/recorded_session.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <utility>

#include "common/decimal.hpp"
#include "common/log.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/late_list.hpp"
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
        {times->sequence, times->capture_time_ns, std::string(times->exposure_ms), false, false});
    return true;
  };
  for_each_line(session_names::kTimes, text, take, session.problems);
}

void parse_drops(std::string_view text, RecordedSession& session) {
  bool is_first = true;
  const auto take = [&](std::string_view line) {
    if (std::exchange(is_first, false)) return line == kDropCsvHeader;
    auto drop = drop_from_csv(line);
    if (!drop) return false;
    if (drop->reason == DropReason::kLate) session.late.insert(drop->sequence);
    if (session.late.contains(drop->sequence)) drop->reason = DropReason::kLate;
    session.drops.push_back(*drop);
    return true;
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

/// Of two lines for one frame the last counts.
void parse_qualities(std::string_view text, RecordedSession& session) {
  bool is_first = true;
  const auto take = [&](std::string_view line) {
    if (std::exchange(is_first, false)) return line == session_lines::kQualityHeader;
    const auto quality = session_lines::parse_quality(line);
    if (quality) session.qualities.insert_or_assign(quality->sequence, *quality);
    return quality.has_value();
  };
  for_each_line(session_names::kQualities, text, take, session.problems);
}

LateList parse_late(std::string_view text, RecordedSession& session) {
  LateList late;
  bool is_first = true;
  const auto take = [&](std::string_view line) {
    if (std::exchange(is_first, false)) return line == session_lines::kLateHeader;
    auto frame = session_lines::parse_late(line);
    if (!frame || !is_decimal(frame->exposure_ms)) return false;
    late.push_back(std::move(*frame));
    return true;
  };
  for_each_line(session_names::kLateList, text, take, session.problems);
  return late;
}

/// Those that times.txt does not have yet, each before the first frame with a higher number. Their
/// checksums count where the frames of the live stream have some, too.
void add_late(LateList late, RecordedSession& session) {
  const bool has_checksums = session.frames.empty() || !session.checksums.empty();
  SequenceSet merged;
  for (const RecordedFrame& frame : session.frames) merged.insert(frame.sequence);
  std::vector<RecordedFrame> added;
  const auto find = [&](const std::string& image, std::uint32_t crc) {
    const std::string place = place_of_late_image(session.folder, image);
    if (has_checksums) session.checksums.insert_or_assign(place, crc);
    return place != image;
  };
  std::ranges::stable_sort(late, {}, &session_lines::Late::sequence);
  for (session_lines::Late& frame : late) {
    session.late.insert(frame.sequence);
    const session_lines::Quality quality{frame.sequence, frame.quality};
    if (quality.is_known()) session.qualities.insert_or_assign(frame.sequence, quality);
    if (merged.contains(frame.sequence)) continue;
    const bool is_left_in_late = find(session_names::left_image(frame.sequence), frame.crc);
    const bool is_right_in_late =
        frame.crc_right && find(session_names::right_image(frame.sequence), *frame.crc_right);
    added.push_back({frame.sequence, frame.capture_time_ns, std::move(frame.exposure_ms),
                     is_left_in_late, is_right_in_late});
  }
  if (added.empty()) return;
  std::vector<RecordedFrame> frames;
  auto next = added.begin();
  for (RecordedFrame& frame : session.frames) {
    while (next != added.end() && next->sequence < frame.sequence) frames.push_back(*next++);
    frames.push_back(std::move(frame));
  }
  frames.insert(frames.end(), next, added.end());
  session.frames = std::move(frames);
}

std::string why_no_session(const fs::path& folder) {
  const fs::path named = folder.has_filename() ? folder : folder.parent_path();
  const std::string recording = session_names::recording(named.filename().string());
  std::error_code ignored;  // then it is no session either
  return fs::exists(folder / recording, ignored)
             ? ": there is only " + recording + ", which is not read: [files] makes what is"
             : ": not a session: neither times.txt, drops.csv nor late.csv in it";
}

}  // namespace

std::string left_image(const RecordedFrame& frame) {
  auto image = session_names::left_image(frame.sequence);
  return frame.is_left_in_late ? session_names::late_image(image) : image;
}

std::string right_image(const RecordedFrame& frame) {
  auto image = session_names::right_image(frame.sequence);
  return frame.is_right_in_late ? session_names::late_image(image) : image;
}

Result<RecordedSession> read_recorded_session(const fs::path& folder) {
  std::error_code ignored;  // what is not there is no session
  if (!fs::exists(folder / session_names::kTimes, ignored) &&
      !fs::exists(folder / session_names::kDrops, ignored) &&
      !fs::exists(folder / session_names::kLateList, ignored)) {
    return Error{folder.string() + why_no_session(folder)};
  }
  RecordedSession session;
  session.folder = folder;
  const auto late_right = session_names::late_image(session_names::kRightImages);
  session.is_stereo = fs::exists(folder / session_names::kRightImages, ignored) ||
                      fs::exists(folder / late_right, ignored);
  auto times = read_text(folder / session_names::kTimes);
  if (!times) return std::move(times).error();
  auto drops = read_text(folder / session_names::kDrops);
  if (!drops) return std::move(drops).error();
  auto calibration = read_text(folder / session_names::kCamera);
  if (!calibration) return std::move(calibration).error();
  const auto segment = read_text(folder / session_names::kSegment);
  if (!segment) return segment.error();
  const auto end = read_text(folder / session_names::kEnd);
  if (!end) return end.error();
  auto checksums = read_text(folder / session_names::kChecksums);
  if (!checksums) return std::move(checksums).error();
  const auto qualities = read_text(folder / session_names::kQualities);
  if (!qualities) return qualities.error();
  const auto late = read_text(folder / session_names::kLateList);
  if (!late) return late.error();
  const auto spool = read_text(folder / session_names::kSpool);
  if (!spool) return spool.error();
  parse_times(times.value(), session);
  parse_checksums(checksums.value(), session);
  parse_qualities(qualities.value(), session);
  add_late(parse_late(late.value(), session), session);
  parse_drops(drops.value(), session);
  session.calibration = std::move(calibration).value();
  const auto info = segment_from_csv(segment.value());
  if (info) session.segment = *info;
  if (!info && !segment.value().empty()) {
    session.problems.push_back(fmt::format("{}: cannot be read", session_names::kSegment));
  }
  session.closing = closing_from_csv(end.value());
  if (!end.value().empty() && !session.closing) {
    session.problems.push_back(fmt::format("{}: cannot be read", session_names::kEnd));
  }
  session.holds = holds_from_csv(spool.value());
  if (!spool.value().empty() && !session.holds) {
    session.problems.push_back(fmt::format("{}: cannot be read", session_names::kSpool));
  }
  return session;
}

std::string quality_line(const RecordedSession& session, Sequence sequence) {
  const auto quality = session.qualities.find(sequence);
  return quality == session.qualities.end() ? "" : to_csv(quality->second) + '\n';
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
