// SPDX-License-Identifier: Apache-2.0
#include "server/session/recovery.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <memory>
#include <string_view>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include "common/as_bytes.hpp"
#include "common/file_io.hpp"
#include "common/log.hpp"
#include "server/session/session_lines.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using journal::Place;

struct PlacedFrame {
  Place place;
  RecordedFrame frame;
};

/// What is not known to be on the device.
struct Unkept {
  std::vector<PlacedFrame> frames;
  Place begin;
  Place invalid = kNowhere;  // the first damage
};

/// The part of one segment.
std::optional<Error> read_segment(const fs::path& folder, std::uint32_t segment, const Place& from,
                                  Unkept& unkept) {
  std::vector<PlacedFrame> frames;
  RecordReader reader(folder, {segment, 0});
  Place end{segment, 0};
  for (std::uint64_t damaged = 0;; damaged = reader.damaged_bytes()) {
    const auto entry = reader.next();
    if (!entry) return entry.error();
    const bool is_here = entry.value() && entry.value()->place.segment == segment;
    const bool has_checkpoint =
        end.offset > 0 ||
        (is_here && std::holds_alternative<SessionSummary>(entry.value()->record.body));
    const bool is_damaged = reader.damaged_bytes() > damaged || !has_checkpoint;
    if (entry.value() && is_damaged && end >= from) unkept.invalid = std::min(unkept.invalid, end);
    if (!is_here) break;
    end = entry.value()->end;
    const auto* const frame = std::get_if<RecordedFrame>(&entry.value()->record.body);
    if (frame != nullptr && entry.value()->place >= from) {
      frames.push_back({entry.value()->place, *frame});
    }
  }
  unkept.frames.insert(unkept.frames.begin(), frames.begin(), frames.end());
  return std::nullopt;
}

/// From `from` on, but if it is nowhere, or with kOff, at most the newest kMostCompared frames.
Result<Unkept> read_unkept(const fs::path& folder, const Place& from, Durability durability) {
  const auto segments = journal::segments_in(folder);
  if (!segments) return segments.error();
  const bool is_limited = durability == Durability::kOff || from == Place{};
  Unkept unkept;
  for (std::size_t i = segments.value().size(); i-- > 0;) {
    const std::uint32_t segment = segments.value()[i];
    if (auto error = read_segment(folder, segment, from, unkept)) return std::move(*error);
    unkept.begin = std::max(from, Place{segment, 0});
    if (segment <= from.segment) break;
    if (is_limited && unkept.frames.size() >= kMostCompared) break;
    const Place before{segment - 1, 0};
    const bool is_missing = i == 0 || segments.value()[i - 1] != before.segment;
    if (is_missing && i > 0) unkept.invalid = std::min(unkept.invalid, std::max(from, before));
  }
  if (is_limited && unkept.frames.size() > kMostCompared) {
    const auto older = unkept.frames.size() - kMostCompared;
    unkept.frames.erase(unkept.frames.begin(),
                        unkept.frames.begin() + static_cast<std::ptrdiff_t>(older));
    unkept.begin = unkept.frames.front().place;
  }
  return unkept;
}

bool can_open_images(const fs::path& folder, const RecordedFrame& frame) {
  const auto can_open = [&](const std::string& image) {
    return static_cast<bool>(UniqueFd(::open((folder / image).c_str(), O_RDONLY | O_CLOEXEC)));
  };
  return can_open(session_names::left_image(frame.sequence)) &&
         (!frame.is_stereo() || can_open(session_names::right_image(frame.sequence)));
}

/// Before the first record that is damaged, or whose images are not whole; kNowhere: all are. An
/// error if the system does not open an image that is there, for want of descriptors perhaps: a
/// power cut is not why.
Result<Place> find_cut(const fs::path& folder, const Unkept& unkept) {
  for (const auto& [place, frame] : unkept.frames) {
    if (place >= unkept.invalid) break;
    const auto images = read_images(folder, frame);
    if (!images && !are_images_gone(folder, frame) && !can_open_images(folder, frame)) {
      return images.error();
    }
    if (!images || !is_whole(frame, images.value())) return place;
  }
  return unkept.invalid;
}

/// Of an image of ours.
std::optional<Sequence> sequence_of(std::string_view image) {
  Sequence sequence = 0;
  const auto [rest, failed] = std::from_chars(image.data(), image.data() + image.size(), sequence);
  if (failed != std::errc{}) return std::nullopt;
  const auto suffix = image.substr(static_cast<std::size_t>(rest - image.data()));
  if (!suffix.starts_with(".jpg")) return std::nullopt;
  return sequence;
}

struct CloseFolder {
  void operator()(DIR* folder) const { ::closedir(folder); }
};

/// The images of either side from `first` on, but those of `known` frames, as paths in the folder.
/// readdir(3), since std::filesystem allocates for each of what may be a million names.
Result<std::vector<std::string>> images_from(const fs::path& folder, Sequence first,
                                             const SequenceSet& known) {
  std::vector<std::string> images;
  for (const char* const side : {session_names::kImages, session_names::kRightImages}) {
    const fs::path path = folder / side;
    const std::unique_ptr<DIR, CloseFolder> names(::opendir(path.c_str()));
    if (!names && errno == ENOENT) continue;
    if (!names) return system_error("read " + path.string(), errno);
    errno = 0;
    while (const dirent* const entry = ::readdir(names.get())) {
      const auto sequence = sequence_of(entry->d_name);
      if (!sequence || *sequence < first || known.contains(*sequence)) continue;
      images.push_back(std::string(side) + "/" + entry->d_name);
    }
    if (errno != 0) return system_error("read " + path.string(), errno);
  }
  return images;
}

/// The numbers of the frames whose records are before `end`.
Result<SequenceSet> read_numbers(const fs::path& folder, const Place& end) {
  SequenceSet numbers;
  const auto insert = [&](const RecordedFrame& frame) { numbers.insert(frame.sequence); };
  if (auto error = for_each<RecordedFrame>(folder, insert, {}, end)) return std::move(*error);
  return numbers;
}

std::optional<Error> set_aside(const fs::path& folder, const std::vector<std::string>& images) {
  std::size_t orphans = 0;
  for (const std::string& image : images) {
    const auto moved = move_to_orphans(folder, image);
    if (!moved) return moved.error();
    orphans += moved.value() ? 1 : 0;
  }
  if (orphans > 0) {
    log_warn("{}: moved {} images without a record to orphans/", folder.string(), orphans);
  }
  return std::nullopt;
}

/// Images of records that were cut off, and images without a record that the live stream may have
/// left.
std::optional<Error> set_aside(const fs::path& folder, const Unkept& unkept,
                               const RecoveredSession& recovered) {
  for (const char* const name : {session_names::kIncoming, session_names::kIncomingRight}) {
    if (const auto moved = move_to_orphans(folder, name); !moved) return moved.error();
  }
  const SessionSummary& summary = recovered.summary;
  const Sequence next = summary.position[wire::kFrames];
  auto known = summary.late_end > next ? read_numbers(folder, recovered.end)
                                       : Result<SequenceSet>(SequenceSet());
  if (!known) return known.error();
  auto images = images_from(folder, next, known.value());
  if (!images) return images.error();
  for (const auto& [place, frame] : unkept.frames) {
    const bool is_cut = place >= recovered.end && frame.sequence < next;
    if (!is_cut || !frame.is_late || frame.is_replacing) continue;
    images.value().push_back(session_names::left_image(frame.sequence));
    images.value().push_back(session_names::right_image(frame.sequence));
  }
  return set_aside(folder, images.value());
}

/// The whole images of a stereo frame take the places of the reduced ones by two renames. If the
/// server was killed in between, this makes the other one.
std::optional<Error> complete_pair(const fs::path& folder) {
  const auto size = [&](const std::string& name) -> std::uintmax_t {
    std::error_code failed;  // then it is as good as missing
    const auto bytes = fs::file_size(folder / name, failed);
    return failed ? 0 : bytes;
  };
  const auto left = size(session_names::kIncoming);
  const auto right = size(session_names::kIncomingRight);
  if ((left > 0) == (right > 0)) return std::nullopt;
  std::optional<Error> error;
  const auto complete = [&](const RecordedFrame& frame) {
    if (!frame.is_stereo() || !frame.is_reduced()) return;
    const auto left_image = session_names::left_image(frame.sequence);
    const auto right_image = session_names::right_image(frame.sequence);
    const auto other = size(left > 0 ? right_image : left_image);
    if (left + right + other != frame.whole_bytes) return;
    const auto images = read_images(folder, frame);
    if (!images || images.value().is_reduced()) return;
    error = left > 0 ? move_file(folder / session_names::kIncoming, folder / left_image)
                     : move_file(folder / session_names::kIncomingRight, folder / right_image);
  };
  auto unread = for_each<RecordedFrame>(folder, complete);
  return unread ? unread : error;
}

/// Where the line of that frame ends, if it is the last one of it and of lower numbers.
Result<std::optional<std::uint64_t>> find_line(int fd, const fs::path& path, Sequence number) {
  struct stat status {};
  if (::fstat(fd, &status) != 0) return system_error("stat " + path.string(), errno);
  const auto size = static_cast<std::uint64_t>(status.st_size);
  for (std::uint64_t bytes = std::uint64_t{64} << 10;; bytes *= 4) {
    std::vector<std::uint8_t> block(static_cast<std::size_t>(std::min(bytes, size)));
    const std::uint64_t begin = size - block.size();
    const auto got = read_at(fd, begin, block, path);
    if (!got) return got.error();
    const std::string_view text(reinterpret_cast<const char*>(block.data()), got.value());
    std::size_t from = begin > 0 ? text.find('\n') + 1 : 0;
    bool has_lower = false;
    std::optional<std::uint64_t> found;
    for (std::size_t end = 0; (end = text.find('\n', from)) != text.npos; from = end + 1) {
      const auto line = session_lines::parse_times(text.substr(from, end - from));
      if (line && line->sequence == number) found = begin + end + 1;
      has_lower = has_lower || (line && line->sequence < number);
    }
    if (found || has_lower || begin == 0) return found;
  }
}

/// The lines of the live frames from `from` on, behind those that are there.
std::optional<Error> append_lines(const fs::path& folder, const Place& from, TimesFile& times) {
  constexpr std::size_t kBlockBytes = 65536;
  const fs::path path = folder / session_names::kTimes;
  std::string lines;
  std::optional<Error> failed;
  const auto write = [&] {
    if (!failed) failed = write_all_at(times.fd.get(), times.bytes, as_bytes(lines), path);
    times.bytes += lines.size();
    lines.clear();
  };
  const auto take = [&](const RecordedFrame& frame) {
    if (!frame.is_late) lines += session_lines::times(frame);
    if (lines.size() >= kBlockBytes) write();
  };
  if (auto error = for_each<RecordedFrame>(folder, take, from)) return error;
  write();
  return failed;
}

}  // namespace

Result<RecoveredSession> recover_session(const fs::path& folder, const SessionInfo& info,
                                         Durability durability) {
  RecoveredSession recovered;
  SessionSummary first;
  first.info = info;
  recovered.summary = first;
  auto tail = read_tail(folder, first, kNowhere);
  if (!tail) return tail.error();
  Unkept unkept;
  if (tail.value()) {
    if (auto error = complete_pair(folder)) return std::move(*error);
    const Place from = std::max(tail.value()->kept, tail.value()->summary.removed);
    auto read = read_unkept(folder, from, durability);
    if (!read) return read.error();
    unkept = std::move(read).value();
    const auto found = find_cut(folder, unkept);
    if (!found) return found.error();
    const Place cut = found.value();
    if (cut < tail.value()->end) {
      const auto lost = std::ranges::count_if(
          unkept.frames, [&](const PlacedFrame& frame) { return frame.place >= cut; });
      tail = read_tail(folder, first, cut);
      if (!tail) return tail.error();
      if (tail.value()) tail.value()->is_clean = false;
      log_error(
          "{}: {} frames at the end are not whole; they are in orphans/ now, and the robot is "
          "asked for them again",
          folder.string(), lost);
    }
  }
  recovered.compared = unkept.begin;
  if (tail.value()) {
    recovered.is_new = false;
    if (const auto bytes = tail.value()->damaged_bytes; bytes > 0) {
      log_warn("{}: {} bytes of its journal are damaged; what they said is missing",
               folder.string(), bytes);
    }
    recovered.summary = std::move(tail.value()->summary);
    recovered.end = tail.value()->end;
    recovered.kept = std::min(tail.value()->kept, recovered.end);
    std::error_code failed;  // then it is as good as missing
    recovered.is_clean =
        tail.value()->is_clean && fs::exists(folder / session_names::kSession, failed);
  }
  if (!recovered.is_clean) {
    if (auto error = set_aside(folder, unkept, recovered)) return std::move(*error);
  }
  return recovered;
}

Result<TimesFile> mend_times(const fs::path& folder, const Place& from) {
  // Where the live stream stood at `from`.
  const auto tail = read_tail(folder, {}, std::max(from, Place{0, 1}));
  if (!tail) return tail.error();
  Sequence next = 0;
  bool is_any = false;
  if (tail.value()) {
    const SessionSummary& summary = tail.value()->summary;
    next = summary.position[wire::kFrames];
    is_any = next > 0;
  }
  const fs::path path = folder / session_names::kTimes;
  TimesFile times;
  times.fd = UniqueFd(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!times.fd) return system_error("open " + path.string(), errno);
  Place begin;
  if (is_any) {
    const auto found = find_line(times.fd.get(), path, next - 1);
    if (!found) return found.error();
    times.bytes = found.value().value_or(0);
    if (found.value()) begin = from;
  }
  if (::ftruncate(times.fd.get(), static_cast<off_t>(times.bytes)) != 0) {
    return system_error("truncate " + path.string(), errno);
  }
  if (auto error = append_lines(folder, begin, times)) return std::move(*error);
  return times;
}

std::optional<Error> set_strangers_aside(const fs::path& folder, const SequenceSet& there) {
  const auto images = images_from(folder, 0, there);
  return images ? set_aside(folder, images.value()) : images.error();
}

Result<bool> move_to_orphans(const fs::path& folder, const std::string& name) {
  std::error_code failed;
  if (!fs::exists(folder / name, failed)) return false;
  const fs::path wanted = folder / session_names::kOrphans / name;
  fs::create_directories(wanted.parent_path(), failed);
  fs::path to = wanted;
  for (int i = 1; !failed && fs::exists(to, failed); ++i)
    to = wanted.string() + "." + std::to_string(i);
  if (!failed) fs::rename(folder / name, to, failed);
  if (failed)
    return system_error("move " + (folder / name).string() + " to orphans", failed.value());
  return true;
}

}  // namespace orbbuf
