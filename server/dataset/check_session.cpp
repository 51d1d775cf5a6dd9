// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/check_session.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <span>
#include <system_error>
#include <utility>

#include "common/calibration/calibration.hpp"
#include "common/crc32.hpp"
#include "common/decimal.hpp"
#include "common/jpeg.hpp"
#include "common/log.hpp"
#include "common/progress.hpp"
#include "common/sample.hpp"
#include "server/dataset/mcap/part.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

class Check {
 public:
  Check(fs::path folder, SessionOutline outline, SequenceSet removed, bool is_open)
      : folder_(std::move(folder)), outline_(std::move(outline)), removed_(std::move(removed)) {
    report_.problems = outline_.problems;
    report_.is_open = is_open && !outline_.summary.has_ended();
  }

  Result<SessionReport> run() && {
    const SessionTotals& totals = outline_.summary.totals;
    Progress progress("check", "frames", static_cast<std::size_t>(totals.live + totals.late));
    const auto drops = for_each_frame(folder_, outline_, [&](const RecordedFrame& frame) {
      check_frame(frame);
      progress.add();
    });
    if (!drops) return drops.error();
    account_for(drops.value());
    check_calibration();
    if (auto error = check_samples()) return std::move(*error);
    check_strays(session_names::kImages);
    check_strays(session_names::kRightImages);
    note_qualities();
    return std::move(report_);
  }

 private:
  template <class... Values>
  void problem(fmt::format_string<Values...> form, Values&&... values) {
    report_.problems.push_back(fmt::format(form, std::forward<Values>(values)...));
  }

  void check_frame(const RecordedFrame& frame) {
    ++(frame.is_late && !frame.is_replacing ? report_.late : report_.live);
    reduced_ += frame.is_reduced() ? 1 : 0;
    replaced_ += frame.is_replacing ? 1 : 0;
    if (before_ && frame.capture_time_ns <= before_->capture_time_ns) {
      problem("frame {} was taken at {} s, not after frame {} at {} s", frame.sequence,
              format_seconds(frame.capture_time_ns), before_->sequence,
              format_seconds(before_->capture_time_ns));
    }
    before_ = frame;
    if (is_no_file(session_names::left_image(frame.sequence))) return;
    if (is_no_file(session_names::right_image(frame.sequence))) return;
    const auto images = read_images(folder_, frame);
    if (!images && removed_.contains(frame.sequence)) return void(++in_recording_);
    if (!images) return problem("frame {}: {}", frame.sequence, images.error().text);
    report_.image_bytes += images.value().jpeg.size();
    const bool is_sound = is_whole(frame, images.value());
    check_image(session_names::left_image(frame.sequence), images.value().left(),
                is_sound ? std::nullopt : std::optional(frame.crc));
    if (!frame.is_stereo()) return;
    check_image(session_names::right_image(frame.sequence), images.value().right(),
                is_sound ? std::nullopt : std::optional(frame.crc_right));
  }

  /// Reading it would wait for a writer.
  bool is_no_file(const std::string& image) {
    std::error_code failed;  // then reading says why
    if (!fs::is_other(folder_ / image, failed)) return false;
    problem("{}: it is a FIFO or a device, not a file", image);
    return true;
  }

  void check_image(const std::string& name, std::span<const std::uint8_t> jpeg,
                   std::optional<std::uint32_t> crc) {
    if (crc && crc32(jpeg) != *crc) {
      return problem("{}: not as it was received, by its checksum", name);
    }
    const auto info = codec_.inspect(jpeg);
    if (!info) problem("{}: {}", name, info.error().text);
  }

  /// Every number is a frame's that is here, or named, or may be on the robot.
  void account_for(const std::vector<DropRecord>& drops) {
    const SessionSummary& summary = outline_.summary;
    const Sequence end = summary.captured();
    const std::uint64_t held = summary.account ? summary.account->held : 0;
    const Sequence first_held = held > 0 ? summary.account->first_held : end;
    report_.captured = end;
    std::uint64_t named = 0;
    std::uint64_t named_may_be_held = 0;
    Sequence next = 0;
    for (const DropRecord& drop : drops) {
      report_.reasons[drop.reason] += drop.frames;
      named += drop.frames;
      if (drop.end() > first_held) {
        named_may_be_held += drop.end() - std::max(first_held, drop.sequence);
      }
      find_unnamed(next, drop.sequence, first_held);
      next = std::max(next, drop.end());
    }
    find_unnamed(next, end, first_held);
    const std::uint64_t unnamed_held = std::min(held, unnamed_may_be_held_);
    const std::uint64_t named_held = std::min(held - unnamed_held, named_may_be_held);
    report_.on_robot = unnamed_held + named_held;
    report_.dropped = named - named_held;
    const std::uint64_t unaccounted = unnamed_ + unnamed_may_be_held_ - unnamed_held;
    if (!report_.is_open) return check_end(unaccounted);
    report_.on_robot += unaccounted;
  }

  /// The numbers in between without a frame.
  void find_unnamed(Sequence begin, Sequence end, Sequence first_held) {
    while ((begin = outline_.there.next_out(begin, end)) < end) {
      Sequence next = outline_.there.next_in(begin, end);
      if (begin < first_held) next = std::min(next, first_held);
      const std::uint64_t count = next - begin;
      (begin < first_held ? unnamed_ : unnamed_may_be_held_) += count;
      if (count == 1) gaps_.push_back(fmt::format("frame {}", begin));
      if (count > 1) gaps_.push_back(fmt::format("frames {} to {}", begin, next - 1));
      begin = next;
    }
  }

  void check_end(std::uint64_t unaccounted) {
    const SessionSummary& summary = outline_.summary;
    if (!summary.has_ended()) {
      if (summary.account && summary.account->is_final) {
        problem("not ended: the robot was killed; frames of its last seconds may be missing");
      } else if (unaccounted > 0) {
        problem("not ended: up to {} frames unaccounted for at the robot's last report",
                unaccounted);
      } else {
        problem("not ended: it is not known how many frames are missing at the end");
      }
    } else if (unaccounted > 0) {
      constexpr std::size_t kMostGaps = 10;
      const auto others = gaps_.size() - std::min(gaps_.size(), kMostGaps);
      gaps_.resize(gaps_.size() - others);
      if (others > 0) gaps_.push_back(fmt::format("{} other gaps", others));
      problem("{} frames neither delivered nor dropped, nor on the robot, among: {}", unaccounted,
              fmt::join(gaps_, ", "));
    }
  }

  void check_calibration() {
    const std::string& calibration = outline_.summary.info.calibration;
    if (calibration.empty()) return;
    const auto camera = parse_calibration(calibration);
    if (camera) return;
    if (parse_any_calibration(calibration)) {
      report_.notes.push_back(camera.error().text);
    } else {
      problem("{}", camera.error().text);
    }
  }

  std::optional<Error> check_samples() {
    for (const wire::StreamDeclaration& stream : outline_.summary.info.streams) {
      const auto read = for_each_sample(folder_, stream, [](const Sample&) {});
      if (!read) return read.error();
      const SampleTotals& totals = read.value();
      const bool is_lost = totals.is_final || totals.lost() == 0;
      report_.notes.push_back(fmt::format(
          "{}: {} samples, {}{} {}", stream.name, totals.samples,
          totals.on_robot > 0 ? fmt::format("{} on the robot, ", totals.on_robot) : "",
          totals.lost(), is_lost ? "lost" : "missing, of which the robot may still have some"));
      if (totals.backward > 0) {
        problem("{}: {} samples are not newer than the one before", stream.name, totals.backward);
      }
      if (totals.behind_frames > 0) {
        report_.notes.push_back(fmt::format("{}: {} samples came behind a newer frame", stream.name,
                                            totals.behind_frames));
      }
    }
    return std::nullopt;
  }

  /// The image of a frame is there before its record is.
  bool may_be_there(Sequence number) const {
    const SessionSummary& summary = outline_.summary;
    const bool is_behind_end = !summary.is_closed && number >= summary.position[wire::kFrames];
    return outline_.there.contains(number) || is_behind_end || report_.is_open;
  }

  /// DSO opens whatever is among the images.
  void check_strays(const char* side) {
    std::error_code failed;
    fs::directory_iterator entry(folder_ / side, failed);
    for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
      const std::string name = entry->path().filename().string();
      const auto number = parse_digits(std::string_view(name).substr(0, name.find('.')));
      if (number && name == session_names::image(*number) && may_be_there(*number)) continue;
      problem("{}/{}: not of any frame of the session", side, printable(name));
    }
    if (failed && failed != std::errc::no_such_file_or_directory) {
      problem("{}: {}", side, failed.message());
    }
  }

  void note_qualities() {
    if (reduced_ + replaced_ > 0) {
      report_.notes.push_back(
          fmt::format("{} of {} frames have a reduced JPEG; {} came reduced, and whole later",
                      reduced_, report_.live + report_.late, replaced_));
    }
    if (in_recording_ > 0) {
      report_.notes.push_back(
          fmt::format("{} images are not kept, but in the MCAP recording", in_recording_));
    }
  }

  const fs::path folder_;
  const SessionOutline outline_;
  const SequenceSet removed_;
  SessionReport report_;
  std::optional<RecordedFrame> before_;
  std::uint64_t reduced_ = 0;
  std::uint64_t replaced_ = 0;
  std::uint64_t in_recording_ = 0;
  std::uint64_t unnamed_ = 0;
  std::uint64_t unnamed_may_be_held_ = 0;
  std::vector<std::string> gaps_;
  JpegCodec codec_;
};

}  // namespace

std::string summary(const SessionReport& report) {
  const std::size_t problems = report.problems.size();
  constexpr double kMiB = 1024.0 * 1024.0;
  const std::string verdict = problems > 0
                                  ? fmt::format("{} problem{}", problems, problems == 1 ? "" : "s")
                              : report.is_open ? "open"
                                               : "OK";
  std::vector<std::string> reasons;
  for (const auto& [reason, frames] : report.reasons) {
    reasons.push_back(fmt::format("{} {}", frames, to_string(reason)));
  }
  const bool has_reasons = !reasons.empty() && report.on_robot == 0;
  return fmt::format(
      "{}: {} captured: {} live, {} late, {} on the robot, {} dropped{}; {:.1f} MiB of images",
      verdict, report.captured, report.live, report.late, report.on_robot, report.dropped,
      has_reasons ? fmt::format(" ({})", fmt::join(reasons, ", ")) : "",
      static_cast<double>(report.image_bytes) / kMiB);
}

Result<SessionReport> check_session(const fs::path& folder, bool is_open) {
  auto outline = read_outline(folder);
  if (!outline) return std::move(outline).error();
  auto removed = mcap::numbers_without_images(folder);
  if (!removed) return std::move(removed).error();
  return Check(folder, std::move(outline).value(), std::move(removed).value(), is_open).run();
}

}  // namespace orbbuf
