// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/join_session.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <map>
#include <optional>
#include <system_error>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/calibration/calibration.hpp"
#include "common/file_io.hpp"
#include "common/journal/journal.hpp"
#include "common/wire.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"
#include "server/session/views.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kSegmentBytes = std::uint64_t{1} << 20;

/// A folder as a server has recorded it.
struct Part {
  fs::path folder;
  SessionOutline outline;
};

/// Whether `whole` is what `reduced` was made from, as far as the records tell.
bool is_whole_of(const RecordedFrame& whole, const RecordedFrame& reduced) {
  return reduced.is_reduced() && !whole.is_reduced() && whole.bytes == reduced.whole_bytes &&
         (whole.is_stereo() || whole.crc == reduced.whole_crc);
}

/// Two qualities of one JPEG, as far as the records tell.
bool are_of_one_image(const RecordedFrame& one, const RecordedFrame& other) {
  if (is_whole_of(one, other) || is_whole_of(other, one)) return true;
  return one.is_reduced() && other.is_reduced() && one.whole_bytes == other.whole_bytes &&
         one.whole_crc == other.whole_crc;
}

/// Whether its images are as they were received. A server that lost its power, and that the robot
/// has not come back to, has the newest records without them, perhaps. None of them was
/// acknowledged.
bool is_there(const Part& part, const RecordedFrame& frame) {
  const bool may_be_lost = frame.is_late || !part.outline.summary.is_closed;
  if (!may_be_lost) return true;
  const auto images = read_images(part.folder, frame);
  return images && is_whole(frame, images.value());
}

bool have_same_bytes(const RecordedFrame& one, const RecordedFrame& other) {
  return one.bytes == other.bytes && one.crc == other.crc && one.crc_right == other.crc_right;
}

class Join {
 public:
  Join(std::vector<Part> parts, fs::path out) : parts_(std::move(parts)), out_(std::move(out)) {
    report_.parts = parts_.size();
    for (const Part& part : parts_) {
      const std::string older = std::move(summary_.info.calibration);
      summary_.info = part.outline.summary.info;
      if (summary_.info.calibration.empty()) summary_.info.calibration = older;
    }
  }

  Result<JoinReport> run() {
    for (const Part& part : parts_) {
      if (auto error = take_frames(part)) return std::move(*error);
    }
    report_.frames = frames_.size();
    if (auto error = write_images()) return std::move(*error);
    if (auto error = write_journal()) return std::move(*error);
    for (const CalibrationFile& file : calibration_files(summary_.info.calibration)) {
      const auto error =
          write_file(out_ / file.name, out_ / session_names::kIncoming, as_bytes(file.text));
      if (error) return *error;
    }
    if (auto error = make_views(out_, Views::kAll)) return std::move(*error);
    return report_;
  }

 private:
  struct Source {
    const Part* part;
    RecordedFrame frame;
  };

  std::optional<Error> take_frames(const Part& part) {
    for (const std::string& problem : part.outline.problems) {
      report_.problems.push_back(part.folder.string() + ": " + problem);
    }
    const auto take = [&](const RecordedFrame& frame) {
      if (!is_there(part, frame)) return;
      const auto [known, is_new] = frames_.try_emplace(frame.sequence, Source{&part, frame});
      if (is_new) return;
      ++report_.repeats;
      const RecordedFrame& other = known->second.frame;
      if (is_whole_of(other, frame)) return;
      if (!have_same_bytes(other, frame) && !are_of_one_image(other, frame)) {
        report_.problems.push_back(fmt::format("frame {}: {} and {} have different ones",
                                               frame.sequence, known->second.part->folder.string(),
                                               part.folder.string()));
      }
      known->second = {&part, frame};
    };
    const auto drops = for_each_frame(part.folder, part.outline, take);
    return drops ? std::nullopt : std::optional(drops.error());
  }

  std::optional<Error> write_images() const {
    for (const auto& [sequence, source] : frames_) {
      if (auto error = link(*source.part, session_names::left_image(sequence))) return error;
      if (!source.frame.is_stereo()) continue;
      if (auto error = link(*source.part, session_names::right_image(sequence))) return error;
    }
    return std::nullopt;
  }

  std::optional<Error> link(const Part& part, const std::string& image) const {
    const fs::path from = part.folder / image;
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

  /// What is named twice, and what is named and there, is the reader's to sort out.
  std::optional<Error> write_journal() {
    // Before the frames: none of them is late.
    for (const Part& part : parts_) {
      const auto take = [&](const RecordedItems& items) {
        if (items.stream >= wire::kFirstOther) append_new(items);
      };
      if (auto error = read_items(part.folder, take)) return error;
    }
    for (const auto& [sequence, source] : frames_) {
      RecordedFrame record = source.frame;
      record.replaced_bytes = 0;
      append(record);
    }
    for (const Part& part : parts_) {
      const std::span<const DropRecord> named = part.outline.named;
      for (std::size_t i = 0; i < named.size(); i += wire::kMaxDropsPerMessage) {
        const auto some = named.subspan(i, std::min(wire::kMaxDropsPerMessage, named.size() - i));
        const std::uint64_t first = summary_.position[wire::kDrops];
        append(RecordedItems{wire::kDrops, first, first + some.size(), wire::encode_drops(some)});
      }
    }
    const SessionClosing& closing = furthest_end();
    if (closing.stats) append(RecordedReport{*closing.stats, closing.clock_offset_ns.value_or(0)});
    if (const auto account = newest_account()) append(*account);
    append(RecordedEnd{closing.has_ended});
    return failed_;
  }

  /// The end of the session is in one of them, if it has one.
  const SessionClosing& furthest_end() const {
    const auto ended = std::ranges::find_if(
        parts_, [](const Part& part) { return part.outline.summary.closing.has_ended; });
    return (ended != parts_.end() ? *ended : parts_.back()).outline.summary.closing;
  }

  /// As far as can be told: what the robot holds only becomes less.
  std::optional<wire::Account> newest_account() const {
    std::optional<wire::Account> newest;
    for (const Part& part : parts_) {
      const auto& account = part.outline.summary.account;
      if (!account) continue;
      const auto age = [](const wire::Account& of) {
        std::uint64_t held = of.held;
        for (const auto& stream : of.streams) held += stream.held;
        return std::pair(!of.is_final, held);
      };
      if (!newest || age(*account) < age(*newest)) newest = account;
    }
    return newest;
  }

  /// Without the samples that the part before has, too: what the robot had no acknowledgement of,
  /// it sent again, in other batches.
  void append_new(const RecordedItems& items) {
    const std::uint64_t from = summary_.position[items.stream];
    if (items.is_late || items.first >= from) return append(items);
    const auto samples = wire::parse_samples(summary_.info.streams, items.stream, items.payload);
    if (!samples || samples.value().size() <= from - items.first) return;
    const auto rest =
        std::span(samples.value()).subspan(static_cast<std::size_t>(from - items.first));
    append(RecordedItems{items.stream, from, items.next, wire::encode_samples(rest)});
  }

  /// Nothing after the first error.
  void append(const RecordBody& body) {
    if (failed_) return;
    const auto place = journal_.append(type_of(body), {encode(body, {})});
    if (!place) failed_ = place.error();
    add(body, summary_);
  }

  const std::vector<Part> parts_;  // the one that got furthest last
  const fs::path out_;
  std::map<Sequence, Source> frames_;
  SessionSummary summary_;  // of what is made
  journal::Writer journal_{out_, kSegmentBytes, false, [this] { return encode(summary_, {}); }};
  std::optional<Error> failed_;
  JoinReport report_;
};

}  // namespace

Result<JoinReport> join_session(const std::vector<fs::path>& folders, const fs::path& out) {
  std::vector<Part> parts;
  for (const fs::path& folder : folders) {
    const auto journal = journal::segments_in(folder);
    if (journal && journal.value().empty()) continue;  // its server died before the first record
    auto outline = read_outline(folder);
    if (!outline) return std::move(outline).error();
    parts.push_back({folder, std::move(outline).value()});
  }
  if (parts.empty()) {
    return Error{fmt::format("cannot join {}: no journal in any of the {} folders", out.string(),
                             folders.size())};
  }
  std::ranges::stable_sort(parts, {}, [](const Part& part) {
    const SessionSummary& summary = part.outline.summary;
    return std::pair(summary.totals.live > 0, summary.position[wire::kFrames]);
  });
  std::error_code failed;
  if (fs::exists(out, failed) && !fs::is_empty(out, failed)) {
    return Error{out.string() + ": is there already, and not empty"};
  }
  fs::create_directories(out / session_names::kImages, failed);
  if (failed) return system_error("create " + out.string(), failed.value());
  return Join(std::move(parts), out).run();
}

}  // namespace orbbuf
