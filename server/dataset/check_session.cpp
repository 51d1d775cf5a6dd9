// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/check_session.hpp"

#include <spdlog/fmt/fmt.h>

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
    report_.dropped = session_.drops.size();
    report_.problems = session_.problems;
  }

  SessionReport run() && {
    for (auto& text : problems_of_order(session_)) report_.problems.push_back(std::move(text));
    check_drops();
    check_gaps();
    check_calibration();
    check_strays(session_names::kImages);
    if (session_.is_stereo) check_strays(session_names::kRightImages);
    Progress progress("check", "frames", session_.frames.size());
    for (const RecordedFrame& frame : session_.frames) {
      check_image(session_names::left_image(frame.sequence));
      if (session_.is_stereo) check_image(session_names::right_image(frame.sequence));
      progress.add();
    }
    return std::move(report_);
  }

 private:
  template <class... Values>
  void problem(fmt::format_string<Values...> form, Values&&... values) {
    report_.problems.push_back(fmt::format(form, std::forward<Values>(values)...));
  }

  void check_drops() {
    for (const RecordedFrame& frame : session_.frames) delivered_.insert(frame.sequence);
    for (const DropRecord& drop : session_.drops) {
      if (!dropped_.insert(drop.sequence).second) {
        problem("drops.csv: frame {} is there twice", drop.sequence);
      }
      if (delivered_.contains(drop.sequence)) {
        problem("drops.csv: frame {} was delivered", drop.sequence);
      }
    }
  }

  void check_gaps() {
    std::set<Sequence> known = delivered_;
    known.insert(dropped_.begin(), dropped_.end());
    Sequence next = 0;
    for (const Sequence sequence : known) {
      if (sequence == next + 1) {
        problem("frame {} was neither delivered nor dropped", next);
      } else if (sequence > next) {
        problem("frames {} to {} were neither delivered nor dropped", next, sequence - 1);
      }
      next = sequence + 1;
    }
    check_end(next);
    check_closing(next);
  }

  void check_closing(Sequence next) {
    if (!session_.closing) return;
    const auto& [has_ended, stats, clock_offset_ns] = *session_.closing;
    const std::uint64_t known = delivered_.size() + dropped_.size();
    if (has_ended && stats && stats->captured > next) {
      problem("frames {} to {} were neither delivered nor dropped", next, stats->captured - 1);
    } else if (!has_ended && stats && stats->captured > known) {
      problem("not ended: up to {} frames unaccounted for at the robot's last report",
              stats->captured - known);
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

  /// DSO opens whatever is among the images.
  void check_strays(const char* folder) {
    std::set<std::string> expected;
    for (const Sequence sequence : delivered_) expected.insert(session_names::image(sequence));
    std::error_code failed;
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
  JpegCodec codec_;
};

}  // namespace

std::string summary(const SessionReport& report) {
  const std::size_t problems = report.problems.size();
  constexpr double kMiB = 1024.0 * 1024.0;
  return fmt::format(
      "{}: {} frames, {} dropped, {:.1f} MiB of images",
      problems == 0 ? "OK" : fmt::format("{} problem{}", problems, problems == 1 ? "" : "s"),
      report.frames, report.dropped, static_cast<double>(report.image_bytes) / kMiB);
}

Result<SessionReport> check_session(const fs::path& folder) {
  auto session = read_recorded_session(folder);
  if (!session) return std::move(session).error();
  return Check(std::move(session).value()).run();
}

}  // namespace orbbuf
