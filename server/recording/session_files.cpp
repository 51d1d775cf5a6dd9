// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_files.hpp"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "common/as_bytes.hpp"
#include "server/recording/false_tail.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/late_list.hpp"
#include "server/recording/sequence_set.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

/// Of an image of ours.
std::optional<Sequence> sequence_of(std::string_view image) {
  Sequence sequence = 0;
  const auto [rest, failed] = std::from_chars(image.data(), image.data() + image.size(), sequence);
  if (failed != std::errc{}) return std::nullopt;
  const auto suffix = image.substr(static_cast<std::size_t>(rest - image.data()));
  if (!suffix.starts_with(".jpg")) return std::nullopt;
  return sequence;
}

std::string times_line(const EncodedFrame& frame) {
  const std::string exposure_ms = session_lines::exposure_ms(frame.exposure_ns);
  return session_lines::to_text({frame.sequence, frame.capture_time_ns, exposure_ms}) + '\n';
}

std::string checksum_lines(const EncodedFrame& frame) {
  const auto line = [](const std::string& image, std::uint32_t crc) {
    return session_lines::checksum(image, crc) + '\n';
  };
  const std::string left = session_names::left_image(frame.sequence);
  if (!frame.is_stereo()) return line(left, frame.jpeg_crc);
  return line(left, wire::crc32(frame.left())) +
         line(session_names::right_image(frame.sequence), wire::crc32(frame.right()));
}

/// Moves the images from `first` on; only what is named as a frame of ours. Returns how many.
Result<std::size_t> orphan_images_from(const fs::path& folder, const char* images, Sequence first,
                                       const SequenceSet& late) {
  std::vector<std::string> orphans;
  std::error_code failed;
  fs::directory_iterator entry(folder / images, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    const auto sequence = sequence_of(entry->path().filename().string());
    if (!sequence || *sequence < first || late.contains(*sequence)) continue;
    orphans.push_back(entry->path().filename().string());
  }
  if (failed && failed != std::errc::no_such_file_or_directory) {
    return system_error("read " + (folder / images).string(), failed.value());
  }
  for (const std::string& name : orphans) {
    const auto moved = move_to_orphans(folder, std::string(images) + "/" + name);
    if (!moved) return moved.error();
  }
  return orphans.size();
}

/// Behind the highest number in times.txt that did not come late.
Result<Sequence> next_of_live_stream(const fs::path& folder, const SequenceSet& late) {
  const auto numbers = read_times_numbers(folder);
  if (!numbers) return numbers.error();
  Sequence next = 0;
  for (const auto& [first, end] : numbers.value().runs()) {
    for (Sequence i = end; i > first; --i) {
      if (late.contains(i - 1)) continue;
      next = i;
      break;
    }
  }
  return next;
}

}  // namespace

SessionFiles::SessionFiles(fs::path folder, std::string calibration, SegmentInfo segment)
    : folder_(std::move(folder)),
      images_(folder_ / session_names::kImages),
      images_right_(folder_ / session_names::kRightImages),
      temporary_(folder_ / session_names::kIncoming),
      calibration_(std::move(calibration)),
      segment_(segment),
      times_(folder_ / session_names::kTimes),
      drops_(folder_ / session_names::kDrops, std::string(kDropCsvHeader)),
      checksums_(folder_ / session_names::kChecksums),
      qualities_(folder_ / session_names::kQualities, std::string(session_lines::kQualityHeader)) {}

/// What a power cut has left behind: lines without their images. False: there are none.
Result<bool> SessionFiles::cut_false_tail() {
  auto tail = find_false_tail(folder_);
  if (!tail) return std::move(tail).error();
  if (tail.value().lines.empty()) return false;
  const fs::path orphans = folder_ / session_names::kOrphans;
  std::error_code failed;
  fs::create_directories(orphans, failed);
  if (failed) return system_error("create " + orphans.string(), failed.value());
  LineFile kept(orphans / session_names::kTimes);
  if (auto error = kept.append(tail.value().lines)) return std::move(*error);
  fs::resize_file(times_.path(), tail.value().offset, failed);
  if (failed) return system_error("truncate " + times_.path().string(), failed.value());
  spdlog::error(
      "{}: {} frames at the end of times.txt are not whole; their lines are in orphans/ now, and "
      "the robot is asked for them again",
      folder_.string(), tail.value().frames);
  return true;
}

Result<wire::Position> SessionFiles::recover() {
  auto times = times_.recover();
  if (!times) return std::move(times).error();
  if (auto recovered = checksums_.recover(); !recovered) return std::move(recovered).error();
  if (auto recovered = qualities_.recover(); !recovered) return std::move(recovered).error();
  auto was_cut = cut_false_tail();
  if (!was_cut) return std::move(was_cut).error();
  if (was_cut.value()) times = times_.recover();
  if (!times) return std::move(times).error();
  auto drops = drops_.recover();
  if (!drops) return std::move(drops).error();

  const auto listed = read_late(folder_);
  if (!listed) return listed.error();
  const SequenceSet late = numbers_of(listed.value());
  wire::Position position = segment_.from;
  if (times.value().lines > 0) {
    const auto last = session_lines::parse_times(times.value().last);
    if (!last) {
      // Taking this for an empty record would remove images that hold data.
      return Error{"resume from " + times_.path().string() + ": the last line, \"" +
                   times.value().last + "\", is not SEQUENCE SECONDS EXPOSURE"};
    }
    position.next_sequence = last->sequence + 1;
    if (late.contains(last->sequence)) {
      const auto live = next_of_live_stream(folder_, late);
      if (!live) return live.error();
      position.next_sequence = std::max(segment_.from.next_sequence, live.value());
    }
  }
  if (drops.value().lines > 0) position.next_drop += drops.value().lines - 1;
  if (auto error = recover_end()) return std::move(*error);
  if (auto moved = move_to_orphans(folder_, session_names::kIncoming); !moved) {
    return std::move(moved).error();
  }
  std::size_t orphans = 0;
  for (const char* images : {session_names::kImages, session_names::kRightImages}) {
    const auto moved = orphan_images_from(folder_, images, position.next_sequence, late);
    if (!moved) return moved.error();
    orphans += moved.value();
  }
  if (orphans > 0) {
    spdlog::warn("{}: moved {} images without a line in times.txt to orphans/", folder_.string(),
                 orphans);
  }
  return position;
}

/// A file that cannot be understood is written anew.
std::optional<Error> SessionFiles::recover_end() {
  const auto end = read_text(folder_ / session_names::kEnd);
  if (!end) return end.error();
  if (const auto closing = closing_from_csv(end.value())) reported_ = *closing;
  reported_.has_ended = false;
  return std::nullopt;
}

std::optional<Error> SessionFiles::write(const EncodedFrame& frame) {
  if (auto error = prepare()) return error;
  const std::string name = session_names::image(frame.sequence);
  auto error = write_file(images_ / name, temporary_, frame.left());
  if (!error && frame.is_stereo()) error = write_right(frame);
  if (!error) error = append_lines(frame);
  if (error) {
    ::unlink((images_ / name).c_str());
    ::unlink((images_right_ / name).c_str());
    is_prepared_ = false;
  }
  return error;
}

std::optional<Error> SessionFiles::append_lines(const EncodedFrame& frame) {
  const session_lines::Quality quality{frame.sequence, frame.quality, frame.whole_bytes,
                                       frame.whole_crc};
  if (quality.is_known()) {
    if (auto error = qualities_.append(to_csv(quality) + '\n')) return error;
  }
  if (auto error = checksums_.append(checksum_lines(frame))) return error;
  return times_.append(times_line(frame));
}

/// The folder is made again if needed, since it is not known beforehand that frames are stereo.
std::optional<Error> SessionFiles::write_right(const EncodedFrame& frame) {
  std::error_code failed;
  fs::create_directory(images_right_, failed);
  if (failed) return system_error("create " + images_right_.string(), failed.value());
  return write_file(images_right_ / session_names::image(frame.sequence), temporary_,
                    frame.right());
}

std::optional<Error> SessionFiles::write_drops(const wire::Dropped& dropped) {
  if (auto error = prepare()) return error;
  std::string lines;
  for (const DropRecord& record : dropped.records) lines += to_csv(record) + '\n';
  auto error = drops_.append(lines);
  if (error) is_prepared_ = false;
  return error;
}

/// Folders and calibration, again after each failure, in case they were removed.
std::optional<Error> SessionFiles::prepare() {
  if (is_prepared_) return std::nullopt;
  std::error_code failed;
  fs::create_directories(images_, failed);
  if (failed) return system_error("create " + images_.string(), failed.value());
  if (!calibration_.empty()) {
    const fs::path camera = folder_ / session_names::kCamera;
    if (auto error = write_file(camera, temporary_, as_bytes(calibration_))) return error;
  }
  if (!segment_.is_first()) {
    const fs::path path = folder_ / session_names::kSegment;
    if (auto error = write_file(path, temporary_, as_bytes(to_csv(segment_)))) return error;
  }
  if (auto error = write_end(reported_)) return error;  // open, also if it had ended before
  is_prepared_ = true;
  return std::nullopt;
}

void SessionFiles::note(const SessionClosing& reported) {
  reported_ = reported;
  if (is_prepared_ && write_end(reported_)) is_prepared_ = false;
}

std::optional<Error> SessionFiles::finish(SessionClosing& closing) {
  std::error_code ignored;  // then writing says why
  if (!is_prepared_ && !fs::exists(folder_ / session_names::kEnd, ignored)) return std::nullopt;
  if (!closing.stats) closing.stats = reported_.stats;
  if (!closing.clock_offset_ns) closing.clock_offset_ns = reported_.clock_offset_ns;
  return write_end(closing);
}

std::optional<Error> SessionFiles::write_end(const SessionClosing& closing) const {
  return write_file(folder_ / session_names::kEnd, temporary_, as_bytes(to_csv(closing)));
}

}  // namespace orbbuf
