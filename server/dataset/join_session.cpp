// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/join_session.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <system_error>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/wire.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/recorded_session.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

class Join {
 public:
  Join(std::vector<RecordedSession> parts, fs::path out)
      : parts_(std::move(parts)), out_(std::move(out)) {
    report_.segments = parts_.size();
  }

  Result<JoinReport> run() {
    for (const RecordedSession& part : parts_) take_frames(part);
    for (const RecordedSession& part : parts_) take_drops(part);
    report_.frames = frames_.size();
    if (auto error = write_images()) return std::move(*error);
    if (auto error = write_lists()) return std::move(*error);
    return report_;
  }

 private:
  /// Where a frame is.
  struct Source {
    const RecordedSession* part;
    const RecordedFrame* frame;
  };

  void take_frames(const RecordedSession& part) {
    for (const std::string& problem : part.problems) {
      report_.problems.push_back(part.folder.string() + ": " + problem);
    }
    for (const RecordedFrame& frame : part.frames) {
      const auto [known, is_new] = frames_.try_emplace(frame.sequence, Source{&part, &frame});
      if (is_new) continue;
      ++report_.repeats;
      const Source other{&part, &frame};
      if (!are_same(known->second, other) && !are_of_one_image(known->second, other)) {
        report_.problems.push_back(fmt::format("frame {}: {} and {} have different ones",
                                               frame.sequence, known->second.part->folder.string(),
                                               part.folder.string()));
      }
      known->second = other;
    }
  }

  using Crc = std::optional<std::uint32_t>;

  /// Of an image as it was received.
  static Crc crc(const Source& source, const std::string& image) {
    const auto found = source.part->checksums.find(image);
    return found == source.part->checksums.end() ? std::nullopt : Crc(found->second);
  }

  /// Of the JPEG that a reduced frame was made from; nothing: it is not reduced.
  static Crc whole_crc(const Source& source) {
    const auto found = source.part->qualities.find(source.frame->sequence);
    if (found == source.part->qualities.end() || found->second.whole_bytes == 0) return {};
    return found->second.whole_crc;
  }

  /// A robot that goes to another server sends a frame again, perhaps in another quality.
  static bool are_of_one_image(const Source& one, const Source& other) {
    if (one.frame->capture_time_ns != other.frame->capture_time_ns) return false;
    const auto [whole_one, whole_other] = std::pair(whole_crc(one), whole_crc(other));
    if (whole_one && whole_other) return whole_one == whole_other;
    if (!whole_one && !whole_other) return false;
    const Source& whole = whole_one ? other : one;
    // The checksum of a pair is not one of its images'.
    return whole.part->is_stereo ||
           crc(whole, left_image(*whole.frame)) == (whole_one ? whole_one : whole_other);
  }

  /// By their checksums.
  static bool are_same(const Source& one, const Source& other) {
    return one.frame->capture_time_ns == other.frame->capture_time_ns &&
           crc(one, left_image(*one.frame)) == crc(other, left_image(*other.frame)) &&
           crc(one, right_image(*one.frame)) == crc(other, right_image(*other.frame));
  }

  /// In the order of the record; the same record in two segments is the robot's repeat.
  void take_drops(const RecordedSession& part) {
    for (const DropRecord& drop : part.drops) {
      if (!dropped_.insert(drop.sequence).second) continue;
      if (frames_.contains(drop.sequence)) {
        ++report_.settled;
      } else {
        drops_.push_back(drop);
      }
    }
  }

  std::optional<Error> write_images() const {
    for (const auto& [sequence, source] : frames_) {
      const fs::path& from = source.part->folder;
      const auto left = session_names::left_image(sequence);
      if (auto error = link(from / left_image(*source.frame), left)) return error;
      if (!source.part->is_stereo) continue;
      const auto right = session_names::right_image(sequence);
      if (auto error = link(from / right_image(*source.frame), right)) return error;
    }
    return std::nullopt;
  }

  std::optional<Error> link(const fs::path& from, const std::string& image) const {
    std::error_code failed;
    fs::create_directories((out_ / image).parent_path(), failed);
    fs::create_hard_link(from, out_ / image, failed);
    if (failed && failed != std::errc::no_such_file_or_directory) {
      fs::copy_file(from, out_ / image, failed);
    }
    if (!failed || failed == std::errc::no_such_file_or_directory) {
      return std::nullopt;  // one that is missing is found by the check
    }
    return system_error("copy " + from.string(), failed.value());
  }

  std::optional<Error> write_lists() const {
    std::string times;
    std::string checksums;
    std::string qualities = std::string(session_lines::kQualityHeader) + '\n';
    for (const auto& [sequence, source] : frames_) {
      times += session_lines::to_text(
                   {sequence, source.frame->capture_time_ns, source.frame->exposure_ms}) +
               '\n';
      const auto add = [&, part = source.part](const std::string& place, const std::string& image) {
        const auto found = part->checksums.find(place);
        if (found == part->checksums.end()) return;
        checksums += session_lines::checksum(image, found->second) + '\n';
      };
      add(left_image(*source.frame), session_names::left_image(sequence));
      add(right_image(*source.frame), session_names::right_image(sequence));
      qualities += quality_line(*source.part, sequence);
    }
    std::string drops = std::string(kDropCsvHeader) + '\n';
    for (const DropRecord& drop : drops_) drops += to_csv(drop) + '\n';
    if (auto error = write(session_names::kTimes, times)) return error;
    if (auto error = write(session_names::kChecksums, checksums)) return error;
    if (auto error = write(session_names::kQualities, qualities)) return error;
    if (auto error = write(session_names::kDrops, drops)) return error;
    const RecordedSession& last = parts_.back();
    if (!last.calibration.empty()) {
      if (auto error = write(session_names::kCamera, last.calibration)) return error;
    }
    if (!last.closing) return std::nullopt;
    return write(session_names::kEnd, to_csv(*last.closing));
  }

  std::optional<Error> write(const char* name, const std::string& text) const {
    return write_file(out_ / name, out_ / session_names::kIncoming, as_bytes(text));
  }

  const std::vector<RecordedSession> parts_;  // by epoch
  const fs::path out_;
  std::map<Sequence, Source> frames_;
  std::set<Sequence> dropped_;
  std::vector<DropRecord> drops_;
  JoinReport report_;
};

}  // namespace

Result<JoinReport> join_session(const std::vector<fs::path>& segments, const fs::path& out) {
  std::vector<RecordedSession> parts;
  for (const fs::path& folder : segments) {
    auto part = read_recorded_session(folder);
    if (!part) return std::move(part).error();
    parts.push_back(std::move(part).value());
  }
  if (parts.empty()) return Error{"no segment of the session was found"};
  std::ranges::stable_sort(parts, {},
                           [](const RecordedSession& part) { return part.segment.epoch; });
  std::error_code failed;
  if (fs::exists(out, failed) && !fs::is_empty(out, failed)) {
    return Error{out.string() + ": is there already, and not empty"};
  }
  fs::create_directories(out / session_names::kImages, failed);
  if (failed) return system_error("create " + out.string(), failed.value());
  return Join(std::move(parts), out).run();
}

}  // namespace orbbuf
