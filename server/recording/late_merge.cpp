// SPDX-License-Identifier: Apache-2.0
#include "server/recording/late_merge.hpp"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "common/as_bytes.hpp"
#include "common/drop_record.hpp"
#include "common/frame.hpp"
#include "common/wire.hpp"
#include "server/recording/false_tail.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/late_list.hpp"
#include "server/recording/line_file.hpp"
#include "server/recording/mcap/recording.hpp"
#include "server/recording/sequence_set.hpp"
#include "server/recording/session_closing.hpp"
#include "server/recording/session_files.hpp"
#include "server/recording/session_info.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using session_lines::Late;

/// Hands each line to `take`, without its end, until `take` says no.
template <class Take>
bool take_lines(std::string_view text, Take take) {
  for (std::size_t end = 0; (end = text.find('\n')) != text.npos; text.remove_prefix(end + 1)) {
    if (!take(text.substr(0, end))) return false;
  }
  return true;
}

bool is_there(const fs::path& path) {
  std::error_code ignored;  // then it is as good as missing
  return fs::exists(path, ignored);
}

/// The images of a frame, where they belong, with their checksums.
std::vector<std::pair<std::string, std::uint32_t>> images_of(const Late& frame) {
  std::vector<std::pair<std::string, std::uint32_t>> images;
  images.emplace_back(session_names::left_image(frame.sequence), frame.crc);
  if (frame.crc_right) {
    images.emplace_back(session_names::right_image(frame.sequence), *frame.crc_right);
  }
  return images;
}

class Merge {
 public:
  Merge(fs::path folder, const std::function<bool()>& may_go_on)
      : folder_(std::move(folder)),
        late_folder_(folder_ / session_names::kLate),
        may_go_on_(may_go_on) {}

  Result<MergedLate> run() && {
    using Step = std::optional<Error> (Merge::*)();
    constexpr std::array<Step, 7> kSteps = {
        &Merge::begin,       &Merge::record,        &Merge::list_checksums, &Merge::list_qualities,
        &Merge::move_images, &Merge::replace_lists, &Merge::remove_late};
    for (const Step step : kSteps) {
      if (auto error = (this->*step)()) return std::move(*error);
      if (!merged_.is_complete) break;
    }
    return merged_;
  }

 private:
  bool may_change() {
    if (!may_go_on_()) merged_.is_complete = false;
    return merged_.is_complete;
  }

  std::optional<Error> begin();
  std::optional<Error> record();
  std::optional<Error> list_checksums();
  std::optional<Error> list_qualities();
  std::optional<Error> move_images();
  std::optional<Error> replace_lists();
  std::optional<Error> remove_late();
  std::optional<Error> remove_folder(const fs::path& folder, const std::string& name);
  Result<mcap::Recording> open_recording() const;
  Result<EncodedFrame> load(const Late& frame) const;
  Result<std::string> merged_times() const;
  Result<std::string> merged_drops() const;
  std::optional<Error> replace(const char* name);

  const fs::path folder_;
  const fs::path late_folder_;
  const std::function<bool()>& may_go_on_;
  wire::Position position_;
  LateList to_merge_;   // sorted by number
  SequenceSet listed_;  // by times.txt, before
  SequenceSet late_;    // those that are merged, and those that will be
  MergedLate merged_;
};

/// Repairs the lists first, so that all that follows can rely on them.
std::optional<Error> Merge::begin() {
  auto late = recover_late(folder_);
  if (!late) return std::move(late).error();
  const auto position = SessionFiles(folder_, "").recover();
  if (!position) return position.error();
  position_ = position.value();
  auto listed = read_times_numbers(folder_);
  if (!listed) return std::move(listed).error();
  listed_ = std::move(listed).value();
  for (Late& frame : late.value()) {
    const auto image = session_names::late_image(session_names::left_image(frame.sequence));
    const bool is_merged = listed_.contains(frame.sequence) && !is_there(folder_ / image);
    if (!is_merged && !is_whole(folder_, frame)) {
      ++merged_.missing;
      continue;
    }
    late_.insert(frame.sequence);
    if (!is_merged) to_merge_.push_back(std::move(frame));
  }
  std::ranges::sort(to_merge_, {}, &Late::sequence);
  return std::nullopt;
}

Result<mcap::Recording> Merge::open_recording() const {
  const auto calibration = read_text(folder_ / session_names::kCamera);
  if (!calibration) return calibration.error();
  const SessionInfo info{folder_.parent_path().filename().string(), folder_.filename().string(),
                         calibration.value()};
  mcap::Recording recording(folder_ / session_names::recording(info.session_id), info);
  if (auto position = recording.recover(position_); !position) return std::move(position).error();
  if (auto error = recording.take_missed(folder_, position_)) return std::move(*error);
  return recording;
}

Result<EncodedFrame> Merge::load(const Late& late) const {
  EncodedFrame frame;
  frame.sequence = late.sequence;
  frame.capture_time_ns = late.capture_time_ns;
  frame.quality = late.quality;
  for (const auto& [image, crc] : images_of(late)) {
    const auto content = read_file(folder_ / place_of_late_image(folder_, image));
    if (!content) return content.error();
    frame.jpeg.insert(frame.jpeg.end(), content.value().begin(), content.value().end());
    if (frame.left_bytes == 0) frame.left_bytes = static_cast<std::uint32_t>(frame.jpeg.size());
  }
  return frame;
}

/// A recording is finished also if a merge before this one has written all to it.
std::optional<Error> Merge::record() {
  const auto path = folder_ / session_names::recording(folder_.filename().string());
  if (to_merge_.empty() || !is_there(path)) return std::nullopt;
  auto recording = open_recording();
  if (!recording) return std::move(recording).error();
  const auto found = recording.value().frames_among(to_merge_);
  if (!found) return found.error();
  for (const Late& late : to_merge_) {
    if (found.value().contains(late.sequence)) continue;
    const auto frame = load(late);
    if (!frame) return frame.error();
    if (!may_change()) return std::nullopt;
    if (auto error = recording.value().write_late(frame.value())) return error;
  }
  const auto end = read_text(folder_ / session_names::kEnd);
  if (!end) return end.error();
  if (!may_change()) return std::nullopt;
  SessionClosing closing = closing_from_csv(end.value()).value_or(SessionClosing{});
  return recording.value().finish(closing);
}

/// A session that was recorded without checksums stays without.
std::optional<Error> Merge::list_checksums() {
  const auto text = read_text(folder_ / session_names::kChecksums);
  if (!text) return text.error();
  if (text.value().empty() && !listed_.empty()) return std::nullopt;
  std::map<std::string_view, std::uint32_t> known;
  take_lines(text.value(), [&](std::string_view line) {
    const auto checksum = session_lines::parse_checksum(line);
    if (checksum) known.insert_or_assign(checksum->image, checksum->crc);
    return true;
  });
  std::string lines;
  for (const Late& frame : to_merge_) {
    for (const auto& [image, crc] : images_of(frame)) {
      const auto checksum = known.find(image);
      if (checksum != known.end() && checksum->second == crc) continue;
      lines += session_lines::checksum(image, crc) + '\n';
    }
  }
  if (lines.empty() || !may_change()) return std::nullopt;
  return LineFile(folder_ / session_names::kChecksums).append(lines);
}

std::optional<Error> Merge::list_qualities() {
  const auto text = read_text(folder_ / session_names::kQualities);
  if (!text) return text.error();
  std::set<std::string_view> known;
  take_lines(text.value(), [&](std::string_view line) { return known.insert(line), true; });
  std::string lines;
  for (const Late& frame : to_merge_) {
    const session_lines::Quality quality{frame.sequence, frame.quality};
    const std::string line = to_csv(quality);
    if (quality.is_known() && !known.contains(line)) lines += line + '\n';
  }
  if (lines.empty() || !may_change()) return std::nullopt;
  return LineFile(folder_ / session_names::kQualities, std::string(session_lines::kQualityHeader))
      .append(lines);
}

std::optional<Error> Merge::move_images() {
  std::error_code failed;
  for (const Late& frame : to_merge_) {
    for (const auto& [image, crc] : images_of(frame)) {
      const fs::path from = folder_ / session_names::late_image(image);
      const fs::path to = folder_ / image;
      if (!is_there(from)) continue;
      if (!may_change()) return std::nullopt;
      fs::create_directories(to.parent_path(), failed);
      if (!failed) fs::rename(from, to, failed);
      if (failed)
        return system_error("move " + from.string() + " to " + to.string(), failed.value());
    }
  }
  return std::nullopt;
}

Result<std::string> Merge::merged_times() const {
  const auto text = read_text(folder_ / session_names::kTimes);
  if (!text) return text.error();
  std::vector<std::pair<Sequence, std::string>> lines;
  std::string foreign;
  take_lines(text.value(), [&](std::string_view line) {
    if (const auto times = session_lines::parse_times(line)) {
      lines.emplace_back(times->sequence, line);
    } else {
      foreign = line;
    }
    return foreign.empty();
  });
  if (!foreign.empty()) {
    return Error{"merge late frames into " + (folder_ / session_names::kTimes).string() + ": \"" +
                 foreign + "\" is not SEQUENCE SECONDS EXPOSURE"};
  }
  for (const Late& frame : to_merge_) {
    if (listed_.contains(frame.sequence)) continue;
    lines.emplace_back(
        frame.sequence,
        session_lines::to_text({frame.sequence, frame.capture_time_ns, frame.exposure_ms}));
  }
  std::ranges::stable_sort(lines, {}, [](const auto& line) { return line.first; });
  std::string merged;
  for (const auto& [sequence, line] : lines) merged += line + '\n';
  return merged;
}

/// As many lines as before, for they are how far the robot's record has come.
Result<std::string> Merge::merged_drops() const {
  const auto text = read_text(folder_ / session_names::kDrops);
  if (!text) return text.error();
  std::string merged;
  take_lines(text.value(), [&](std::string_view line) {
    auto drop = drop_from_csv(line);
    const bool is_late = drop && late_.contains(drop->sequence);
    if (is_late) drop->reason = DropReason::kLate;
    merged += is_late ? to_csv(*drop) : std::string(line);
    merged += '\n';
    return true;
  });
  return merged;
}

/// The new file is in late/ and on the device.
std::optional<Error> Merge::replace(const char* name) {
  const fs::path from = late_folder_ / name;
  if (!is_there(from) || !may_change()) return std::nullopt;
  std::error_code failed;
  fs::rename(from, folder_ / name, failed);
  if (!failed) return std::nullopt;
  return system_error("replace " + (folder_ / name).string(), failed.value());
}

/// Both are made anew by each merge: what one has left may be older than the lists.
std::optional<Error> Merge::replace_lists() {
  const auto times = merged_times();
  if (!times) return times.error();
  const auto drops = merged_drops();
  if (!drops) return drops.error();
  const fs::path temporary = late_folder_ / session_names::kIncoming;
  for (const auto& [name, text] : {std::pair{session_names::kTimes, &times.value()},
                                   std::pair{session_names::kDrops, &drops.value()}}) {
    if (text->empty()) continue;
    if (!may_change()) return std::nullopt;
    if (auto error = write_file(late_folder_ / name, temporary, as_bytes(*text))) return error;
  }
  if (auto error = sync_file_system(folder_)) return error;
  for (const char* name : {session_names::kTimes, session_names::kDrops}) {
    if (auto error = replace(name)) return error;
    if (!merged_.is_complete) return std::nullopt;
  }
  for (const Late& frame : to_merge_) merged_.frames += listed_.contains(frame.sequence) ? 0 : 1;
  return sync_file_system(folder_);
}

/// name: of the folder in the session's folder. What is in it now is nothing of ours, but a
/// temporary file.
std::optional<Error> Merge::remove_folder(const fs::path& folder, const std::string& name) {
  std::vector<std::string> left;
  std::error_code failed;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    left.push_back(entry->path().filename().string());
  }
  if (failed == std::errc::no_such_file_or_directory) return std::nullopt;
  if (failed) return system_error("read " + folder.string(), failed.value());
  for (const std::string& file : left) {
    if (!may_change()) return std::nullopt;
    if (file == session_names::kIncoming) {
      ::unlink((folder / file).c_str());
    } else if (const auto moved = move_to_orphans(folder_, fmt::format("{}/{}", name, file));
               !moved) {
      return moved.error();
    }
  }
  if (!may_change()) return std::nullopt;
  if (::rmdir(folder.c_str()) == 0) return std::nullopt;
  return system_error("remove " + folder.string(), errno);
}

std::optional<Error> Merge::remove_late() {
  for (const std::string& images :
       {std::string(session_names::kImages), std::string(session_names::kRightImages)}) {
    const std::string name = session_names::late_image(images);
    if (auto error = remove_folder(folder_ / name, name)) return error;
    if (!merged_.is_complete) return std::nullopt;
  }
  if (merged_.missing > 0) {
    spdlog::error("{}: {} late frames are not as they came, and could not be merged",
                  folder_.string(), merged_.missing);
  }
  return remove_folder(late_folder_, session_names::kLate);
}

}  // namespace

Result<MergedLate> merge_late(const fs::path& folder, const std::function<bool()>& may_go_on) {
  if (!is_there(folder / session_names::kLate)) return MergedLate{};
  return Merge(folder, may_go_on).run();
}

}  // namespace orbbuf
