// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/check_session.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <limits>
#include <set>
#include <span>
#include <system_error>
#include <utility>

#include "common/jpeg.hpp"
#include "common/log.hpp"
#include "common/progress.hpp"
#include "common/wire.hpp"
#include "server/calibration/calibration.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/recorded_session.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

class Check {
 public:
  explicit Check(RecordedSession session) : session_(std::move(session)) {
    report_.frames = session_.frames.size();
    report_.problems = session_.problems;
  }

  SessionReport run() && {
    for (auto& text : problems_of_order(session_)) report_.problems.push_back(std::move(text));
    note_reduced();
    check_drops();
    check_gaps();
    count_missing();
    check_calibration();
    check_strays(session_names::kImages, left_image);
    if (session_.is_stereo) check_strays(session_names::kRightImages, right_image);
    Progress progress("check", "frames", session_.frames.size());
    for (const RecordedFrame& frame : session_.frames) {
      check_image(left_image(frame));
      if (session_.is_stereo) check_image(right_image(frame));
      progress.add();
    }
    return std::move(report_);
  }

 private:
  template <class... Values>
  void problem(fmt::format_string<Values...> form, Values&&... values) {
    report_.problems.push_back(fmt::format(form, std::forward<Values>(values)...));
  }

  void note_reduced() {
    const auto reduced = std::ranges::count_if(session_.frames, [&](const RecordedFrame& frame) {
      const auto quality = session_.qualities.find(frame.sequence);
      return quality != session_.qualities.end() && quality->second.whole_bytes > 0;
    });
    if (reduced == 0) return;
    report_.notes.push_back(fmt::format("{} of {} frames were sent with a reduced JPEG", reduced,
                                        session_.frames.size()));
  }

  void check_drops() {
    for (const RecordedFrame& frame : session_.frames) {
      delivered_.insert(frame.sequence);
      if (session_.late.contains(frame.sequence)) ++report_.late;
    }
    for (const DropRecord& drop : session_.drops) {
      const bool is_late = drop.reason == DropReason::kLate;
      const bool is_there = delivered_.contains(drop.sequence);
      if (!dropped_.insert(drop.sequence).second) {
        problem("drops.csv: frame {} is there twice", drop.sequence);
      }
      if (is_there && !is_late) problem("drops.csv: frame {} was delivered", drop.sequence);
      if (!is_there && is_late)
        problem("drops.csv: frame {} came late, and is gone", drop.sequence);
      if (!is_there) ++report_.dropped;
    }
  }

  void check_gaps() {
    std::set<Sequence> known = delivered_;
    known.insert(dropped_.begin(), dropped_.end());
    end_ = session_.segment.from.next_sequence;  // what is before, others have
    known.erase(known.begin(), known.lower_bound(end_));
    for (const Sequence sequence : known) {
      if (sequence > end_) report_gap(end_, sequence);
      end_ = sequence + 1;
    }
    check_end(end_);
    check_closing(known.size());
  }

  /// Numbers from `first` up to `end` that no list has.
  void report_gap(Sequence first, Sequence end) {
    const Sequence held = std::clamp(first_held(), first, end);
    const auto add = [&](Sequence from, Sequence to, const char* singular, const char* plural) {
      if (to == from + 1) problem("frame {} {}", from, singular);
      if (to > from + 1) problem("frames {} to {} {}", from, to - 1, plural);
    };
    add(first, held, "was neither delivered nor dropped", "were neither delivered nor dropped");
    add(held, end, "is still on the robot, or lost", "are still on the robot, or lost");
  }

  /// What is missing from here on may be what the robot still has.
  Sequence first_held() const {
    const bool holds = session_.holds && session_.holds->held > 0;
    return holds ? session_.holds->first : std::numeric_limits<Sequence>::max();
  }

  void count_missing() {
    const auto missing_up_to = [&](Sequence end) {
      const auto there = std::distance(delivered_.begin(), delivered_.lower_bound(end));
      return end - static_cast<std::uint64_t>(there);
    };
    const auto missing = missing_up_to(end_);
    const auto held = session_.holds ? session_.holds->held : 0;
    const auto may_be_held = missing - missing_up_to(std::min(first_held(), end_));
    report_.on_robot = held;
    report_.lost = missing - std::min(held, may_be_held);
  }

  void check_closing(std::uint64_t known) {
    if (!session_.closing) return;
    const auto& [has_ended, stats, clock_offset_ns] = *session_.closing;
    if (has_ended && stats && stats->captured > end_) {
      report_gap(end_, stats->captured);
      end_ = stats->captured;
    } else if (!has_ended && stats && stats->captured > known) {
      problem("not ended: up to {} frames unaccounted for at the robot's last report",
              stats->captured - known);
      end_ = std::max(end_, stats->captured);
    } else if (!has_ended) {
      problem("not ended: it is not known how many frames are missing at the end");
    }
  }

  /// A frame's checksum is written before its line of times.txt, so one may be ahead of that.
  void check_end(Sequence end) {
    Sequence received = end;
    while (session_.checksums.contains(session_names::left_image(received))) ++received;
    if (received < end + 2) return;
    problem("frames {} to {} have their checksums, but no line in times.txt", end, received - 1);
  }

  void check_calibration() {
    if (session_.calibration.empty()) return;
    const auto camera = parse_calibration(session_.calibration);
    if (!camera) problem("camera.txt: {}", camera.error().text);
  }

  /// DSO opens whatever is among the images. Late frames have theirs elsewhere until they are
  /// merged, and if all are late there may be no such folder yet.
  void check_strays(const char* folder, std::string (*image_of)(const RecordedFrame&)) {
    std::set<std::string> expected;
    for (const RecordedFrame& frame : session_.frames) {
      const std::string image = image_of(frame);
      if (image.starts_with(folder)) expected.insert(session_names::image(frame.sequence));
    }
    std::error_code failed;
    if (expected.empty() && !fs::exists(session_.folder / folder, failed)) return;
    fs::directory_iterator entry(session_.folder / folder, failed);
    for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
      const std::string name = entry->path().filename().string();
      if (!expected.contains(name)) {
        problem("{}/{}: without a line in times.txt", folder, printable(name));
      }
    }
    if (failed) problem("{}: {}", folder, failed.message());
  }

  void check_image(const std::string& name) {
    const fs::path path = session_.folder / name;
    std::error_code ignored;  // then reading says why
    if (!fs::exists(path, ignored) && !ignored) return problem("{}: missing", name);
    const auto content = read_file(path);
    if (!content) return problem("{}", content.error().text);
    const std::span<const std::uint8_t> bytes = content.value();
    report_.image_bytes += bytes.size();
    const auto checksum = session_.checksums.find(name);
    if (checksum != session_.checksums.end() && wire::crc32(bytes) != checksum->second) {
      return problem("{}: not as it was received, by its checksum", name);
    }
    if (checksum == session_.checksums.end() && !session_.checksums.empty()) {
      problem("{}: without a checksum", name);
    }
    const auto info = codec_.inspect(bytes);
    if (!info) return problem("{}: {}", name, info.error().text);
    if (checksum != session_.checksums.end()) return;
    const auto pixels = codec_.decode_gray(bytes, 8);
    if (!pixels) problem("{}: {}", name, pixels.error().text);
  }

  const RecordedSession session_;
  SessionReport report_;
  std::set<Sequence> delivered_;
  std::set<Sequence> dropped_;
  Sequence end_ = 0;  // behind the last number that is known to be captured
  JpegCodec codec_;
};

}  // namespace

std::string summary(const SessionReport& report) {
  const std::size_t problems = report.problems.size();
  constexpr double kMiB = 1024.0 * 1024.0;
  const std::string verdict =
      problems == 0 ? "OK" : fmt::format("{} problem{}", problems, problems == 1 ? "" : "s");
  const double mib = static_cast<double>(report.image_bytes) / kMiB;
  if (report.late == 0 && report.on_robot == 0) {
    return fmt::format("{}: {} frames, {} dropped, {:.1f} MiB of images", verdict, report.frames,
                       report.dropped, mib);
  }
  return fmt::format(
      "{}: {} captured: {} live, {} late, {} on the robot, {} lost; {:.1f} MiB of images", verdict,
      report.frames + report.on_robot + report.lost, report.frames - report.late, report.late,
      report.on_robot, report.lost, mib);
}

Result<SessionReport> check_session(const fs::path& folder) {
  auto session = read_recorded_session(folder);
  if (!session) return std::move(session).error();
  return Check(std::move(session).value()).run();
}

}  // namespace orbbuf
