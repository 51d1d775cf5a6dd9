// SPDX-License-Identifier: Apache-2.0
#include "server/session/session_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <variant>

#include "common/crc32.hpp"
#include "common/file_io.hpp"
#include "common/journal/journal.hpp"
#include "common/log.hpp"
#include "server/session/session_lines.hpp"
#include "server/session/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

/// Of a journal whose checkpoints are all damaged, as far as its place tells.
SessionSummary summary_of(const fs::path& folder) {
  SessionSummary summary;
  const fs::path named = folder.has_filename() ? folder : folder.parent_path();
  summary.info.robot_id = named.parent_path().filename().string();
  summary.info.session_id = named.filename().string();
  return summary;
}

bool has_journal(const fs::path& folder) {
  const auto segments = journal::segments_in(folder);
  return segments && !segments.value().empty();
}

/// What the folder is instead, and which to name.
Error no_session(const fs::path& folder) {
  std::error_code failed;
  fs::path latest;
  fs::directory_iterator entry(folder, failed);
  if (failed) return system_error(folder.string() + ": not a session", failed.value());
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    if (has_journal(entry->path())) latest = std::max(latest, entry->path());
  }
  if (latest.empty()) return Error{folder.string() + ": not a session: no journal in it"};
  return Error{folder.string() +
               ": not a session, but the folder of a robot: name one of its sessions, such as " +
               latest.string()};
}

/// The journal is of another session than the lists beside it; empty: it is not, as far as they
/// tell.
std::string find_foreign_journal(const fs::path& folder, const SessionInfo& info) {
  const auto lists = read_regular(folder / session_names::kSession);
  if (!lists) return "";
  const std::string text(lists.value().begin(), lists.value().end());
  if (text.empty() || text.starts_with(session_lines::names(info))) return "";
  return fmt::format("the journal is of session {} of robot {}, and session.txt is not",
                     info.session_id, info.robot_id);
}

/// By number; of two for one number the last counts.
void put_in_order(std::vector<RecordedFrame>& frames) {
  std::ranges::stable_sort(frames, {}, &RecordedFrame::sequence);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (i + 1 < frames.size() && frames[i + 1].sequence == frames[i].sequence) continue;
    frames[kept++] = frames[i];
  }
  frames.resize(kept);
}

/// The numbers from `from` to `end` of which there is no frame, as parts of `range`.
void add_missing(const SequenceSet& there, const DropRecord& range, Sequence from, Sequence end,
                 std::vector<DropRecord>& drops) {
  while ((from = there.next_out(from, end)) < end) {
    const Sequence next = there.next_in(from, end);
    drops.push_back(range.part(from, next));
    from = next;
  }
}

/// What is named and not there, and what is neither, both by number.
class Drops {
 public:
  explicit Drops(const SessionOutline& outline) : there_(outline.there) {
    auto named = outline.named;
    std::ranges::stable_sort(named, {}, &DropRecord::sequence);
    const SessionSummary& summary = outline.summary;
    Sequence covered = 0;
    const Sequence end = end_of_gaps(summary);
    for (const DropRecord& range : named) {
      if (range.end() <= covered) continue;
      const Sequence begin = std::max(covered, range.sequence);
      add_gap(covered, std::min(begin, end), summary);
      add_missing(there_, range, begin, range.end(), named_);
      covered = range.end();
    }
    add_gap(covered, end, summary);
  }

  /// All frames, by number: the gaps lie between their times.
  void add(Sequence sequence, std::int64_t capture_time_ns) {
    for (; next_gap_ < gaps_.size() && gaps_[next_gap_].sequence < sequence; ++next_gap_) {
      DropRecord& gap = gaps_[next_gap_];
      const auto [first, first_ns] = before_.value_or(std::pair(sequence, capture_time_ns));
      const DropRecord around{first,
                              first_ns,
                              gap.reason,
                              kUnknownSimilarity,
                              before_ ? sequence - first + 1 : 1,
                              capture_time_ns};
      gap.capture_time_ns = before_ ? around.capture_time_of(gap.sequence) : capture_time_ns;
      gap.last_capture_time_ns = before_ ? around.capture_time_of(gap.end() - 1) : capture_time_ns;
    }
    before_ = {sequence, capture_time_ns};
  }

  std::vector<DropRecord> take() && {
    std::vector<DropRecord> all(named_.size() + gaps_.size());
    std::ranges::merge(named_, gaps_, all.begin(), {}, &DropRecord::sequence,
                       &DropRecord::sequence);
    return all;
  }

 private:
  /// Without a final account anything may still come; what the robot holds will.
  static Sequence end_of_gaps(const SessionSummary& summary) {
    if (!summary.account || !summary.account->is_final) return 0;
    const Sequence captured = summary.captured();
    return summary.account->held > 0 ? std::min(captured, summary.account->first_held) : captured;
  }

  void add_gap(Sequence begin, Sequence end, const SessionSummary& summary) {
    if (begin >= end) return;
    const Sequence confirmed = std::clamp(summary.account->confirmed, begin, end);
    const auto add = [&](Sequence from, Sequence to, DropReason reason) {
      add_missing(there_, {from, 0, reason, kUnknownSimilarity, to - from, 0}, from, to, gaps_);
    };
    if (begin < confirmed) add(begin, confirmed, DropReason::kLost);
    if (confirmed < end) add(confirmed, end, DropReason::kUnknown);
  }

  const SequenceSet& there_;
  std::vector<DropRecord> named_;
  std::vector<DropRecord> gaps_;
  std::size_t next_gap_ = 0;  // whose time is not known yet
  std::optional<std::pair<Sequence, std::int64_t>> before_;
};

/// The late samples of a stream, by number, each once: the places of their records in memory, and
/// the samples of one record.
class LateSamples {
 public:
  LateSamples(fs::path folder, const wire::StreamDeclaration& stream)
      : folder_(std::move(folder)), stream_(stream) {}

  std::optional<Error> find() {
    RecordReader reader(folder_);
    for (;;) {
      const auto entry = reader.next();
      if (!entry) return entry.error();
      if (!entry.value()) break;
      const auto* const items = std::get_if<RecordedItems>(&entry.value()->record.body);
      if (items == nullptr || items->stream != stream_.id || !items->is_late) continue;
      places_.emplace_back(items->first, entry.value()->place);
      end_ = std::max(end_, items->next);
    }
    std::ranges::sort(places_);
    return std::nullopt;
  }

  /// And forgets one of that number: it came live as well.
  template <class Take>
  std::optional<Error> take_below(std::uint64_t number, Take take) {
    for (;;) {
      for (; at_ < samples_.size() && number_ < number; ++at_, ++number_) {
        if (number_ < next_) continue;  // another record had it
        next_ = number_ + 1;
        take(samples_[at_]);
      }
      if (at_ < samples_.size() || next_place_ == places_.size()) break;
      if (places_[next_place_].first >= number) break;
      if (auto error = read_next()) return error;
    }
    next_ = std::max(next_, number + 1);
    return std::nullopt;
  }

  std::uint64_t end() const { return end_; }

 private:
  /// A record that is damaged by now has none.
  std::optional<Error> read_next() {
    const auto& [first, place] = places_[next_place_++];
    if (!reader_ || reader_->place() != place) reader_.emplace(folder_, place);
    const auto entry = reader_->next();
    if (!entry) return entry.error();
    samples_.clear();
    at_ = 0;
    number_ = first;
    if (!entry.value() || entry.value()->place != place) return std::nullopt;
    const auto* const items = std::get_if<RecordedItems>(&entry.value()->record.body);
    if (items == nullptr) return std::nullopt;
    auto samples = wire::parse_samples(stream_.codec, items->payload);
    if (samples) samples_ = std::move(samples).value();
    return std::nullopt;
  }

  const fs::path folder_;
  const wire::StreamDeclaration& stream_;
  std::vector<std::pair<std::uint64_t, journal::Place>> places_;  // by the first number
  std::size_t next_place_ = 0;
  std::optional<RecordReader> reader_;
  std::vector<Sample> samples_;  // of the record before it
  std::size_t at_ = 0;           // those before it were taken, or are not needed
  std::uint64_t number_ = 0;     // of samples_[at_]
  std::uint64_t next_ = 0;       // those below it are done
  std::uint64_t end_ = 0;
};

/// What the robot says of the samples; nothing: it captures more of them.
std::optional<wire::StreamAccount> account_of(const SessionSummary& summary,
                                              wire::StreamId stream) {
  if (!summary.account || !summary.account->is_final) return std::nullopt;
  for (const wire::StreamAccount& each : summary.account->streams) {
    if (each.stream.id == stream) return each;
  }
  return std::nullopt;
}

/// The place of the newest segment that begins with a checkpoint of which `is_early_enough`, or of
/// the oldest segment.
Result<journal::Place> find_segment(
    const fs::path& folder, const std::function<bool(const SessionSummary&)>& is_early_enough) {
  const auto segments = journal::segments_in(folder);
  if (!segments) return segments.error();
  for (std::size_t i = segments.value().size(); i-- > 1;) {
    const journal::Place place{segments.value()[i], 0};
    const auto first = RecordReader(folder, place).next();
    if (!first) return first.error();
    if (!first.value() || first.value()->place != place) continue;
    const auto* const summary = std::get_if<SessionSummary>(&first.value()->record.body);
    if (summary != nullptr && is_early_enough(*summary)) return place;
  }
  return journal::Place{segments.value().empty() ? 0 : segments.value().front(), 0};
}

/// The images are in these two files.
Result<EncodedFrame> read_frame(const RecordedFrame& recorded, const fs::path& left_path,
                                const fs::path& right_path) {
  auto left = read_file(left_path);
  if (!left) return std::move(left).error();
  EncodedFrame frame;
  frame.sequence = recorded.sequence;
  frame.capture_time_ns = recorded.capture_time_ns;
  frame.exposure_ns = recorded.exposure_ns;
  frame.width_px = recorded.width_px;
  frame.height_px = recorded.height_px;
  frame.quality = recorded.quality;
  frame.whole_bytes = recorded.whole_bytes;
  frame.whole_crc = recorded.whole_crc;
  frame.jpeg = std::move(left).value();
  frame.left_bytes = static_cast<std::uint32_t>(frame.jpeg.size());
  if (recorded.is_stereo()) {
    const auto right = read_file(right_path);
    if (!right) return right.error();
    frame.jpeg.insert(frame.jpeg.end(), right.value().begin(), right.value().end());
  }
  frame.jpeg_crc = crc32(frame.jpeg);
  if (frame.jpeg.size() == frame.whole_bytes && frame.jpeg_crc == frame.whole_crc) {
    frame.quality = 0;  // replaced meanwhile
    frame.whole_bytes = frame.whole_crc = 0;
  }
  return frame;
}

}  // namespace

Result<SessionOutline> read_outline(const fs::path& folder) {
  SessionOutline outline;
  outline.summary = summary_of(folder);
  RecordReader reader(folder);
  for (;;) {
    auto entry = reader.next();
    if (!entry) return std::move(entry).error();
    if (!entry.value()) break;
    const RecordBody& body = entry.value()->record.body;
    add(body, outline.summary);
    if (const auto* const frame = std::get_if<RecordedFrame>(&body)) {
      outline.there.insert(frame->sequence);
      if (frame->is_late) outline.late.push_back(*frame);
    }
    const auto named = named_by(body);
    outline.named.insert(outline.named.end(), named.begin(), named.end());
  }
  outline.end = reader.place();
  if (outline.end == journal::Place{}) {
    const auto segments = journal::segments_in(folder);
    if (!segments) return segments.error();
    if (segments.value().empty()) return no_session(folder);
  }
  // orbbufd's record has journals with other records, and this file.
  std::error_code absent;
  if (outline.there.empty() && fs::exists(folder / "lock", absent)) {
    return Error{folder.string() +
                 ": not a session, but the record of an orbbufd (spool.path or "
                 "buffer.drop_log); sessions are in the server's files.path"};
  }
  if (reader.damaged_bytes() > 0) {
    outline.problems.push_back(fmt::format(
        "journal: {} bytes are damaged; the frames and drop records in them are missing",
        reader.damaged_bytes()));
  }
  const auto foreign = find_foreign_journal(folder, outline.summary.info);
  if (!foreign.empty()) outline.problems.push_back(foreign);
  put_in_order(outline.late);
  return outline;
}

Result<std::vector<DropRecord>> for_each_frame(
    const fs::path& folder, const SessionOutline& outline,
    const std::function<void(const RecordedFrame&)>& take) {
  Drops drops(outline);
  Sequence next = 0;
  const auto hand_on = [&](const RecordedFrame& frame) {
    next = frame.sequence + 1;
    drops.add(frame.sequence, frame.capture_time_ns);
    take(frame);
  };
  auto late = outline.late.begin();
  const auto take_live = [&](const RecordedFrame& frame) {
    if (frame.is_late || frame.sequence < next) return;
    while (late != outline.late.end() && late->sequence <= frame.sequence) hand_on(*late++);
    if (next <= frame.sequence) hand_on(frame);
  };
  if (auto error = for_each<RecordedFrame>(folder, take_live, {}, outline.end)) {
    return std::move(*error);
  }
  while (late != outline.late.end()) hand_on(*late++);
  if (const auto& account = outline.summary.account) {
    drops.add(outline.summary.captured(), account->last_capture_time_ns);
  }
  return std::move(drops).take();
}

Result<RecordedSession> read_session(const fs::path& folder) {
  auto outline = read_outline(folder);
  if (!outline) return std::move(outline).error();
  RecordedSession session;
  const SessionTotals& totals = outline.value().summary.totals;
  session.frames.reserve(
      static_cast<std::size_t>(std::min<std::uint64_t>(totals.live + totals.late, 1U << 24)));
  auto drops = for_each_frame(folder, outline.value(),
                              [&](const RecordedFrame& frame) { session.frames.push_back(frame); });
  if (!drops) return std::move(drops).error();
  session.folder = folder;
  session.summary = std::move(outline.value().summary);
  session.drops = std::move(drops).value();
  session.problems = std::move(outline.value().problems);
  return session;
}

std::optional<Error> read_items(const fs::path& folder,
                                const std::function<void(const RecordedItems&)>& take) {
  return for_each<RecordedItems>(folder, take);
}

Result<std::optional<Tail>> read_tail(const fs::path& folder, const SessionSummary& first,
                                      const journal::Place& until) {
  const auto segments = journal::segments_in(folder);
  if (!segments) return segments.error();
  for (std::size_t i = segments.value().size(); i-- > 0;) {
    const journal::Place begin{segments.value()[i], 0};
    if (begin >= until) continue;
    RecordReader reader(folder, begin);
    Tail tail{first, begin, {}};
    for (bool is_first = true;; is_first = false) {
      const auto entry = reader.next();
      if (!entry) return entry.error();
      if (!entry.value() || entry.value()->place >= until) break;
      const auto& [place, end, record] = *entry.value();
      const bool is_checkpoint = std::holds_alternative<SessionSummary>(record.body);
      if (is_first && i > 0 && (!is_checkpoint || place != begin)) break;
      add(record.body, tail.summary);
      tail.end = end;
      tail.kept = record.kept;
      tail.is_clean = is_clean_after(record.body, tail.is_clean);
      tail.damaged_bytes = reader.damaged_bytes();
    }
    if (tail.end != begin) return std::optional(std::move(tail));
  }
  return std::optional<Tail>();
}

Result<SampleTotals> for_each_sample(const fs::path& folder, const wire::StreamDeclaration& stream,
                                     const std::function<void(const Sample&)>& take) {
  SampleTotals totals;
  LateSamples late(folder, stream);
  std::optional<wire::StreamAccount> account;
  if (const auto summary = read_summary(folder)) {
    account = account_of(*summary, stream.id);
    if (account) totals.next = account->captured;
    totals.is_final = account.has_value();
    if (summary->totals.late_items > 0) {
      if (auto error = late.find()) return std::move(*error);
    }
  }
  std::optional<std::int64_t> last_ns;
  const auto hand_on = [&](const Sample& sample) {
    ++totals.samples;
    if (last_ns && sample.time_ns <= *last_ns && !sample.message) ++totals.backward;
    last_ns = sample.time_ns;
    take(sample);
  };
  std::optional<std::int64_t> newest_frame_ns;
  RecordReader reader(folder);
  for (;;) {
    const auto entry = reader.next();
    if (!entry) return entry.error();
    if (!entry.value()) {
      if (auto error = late.take_below(~std::uint64_t{0}, hand_on)) return std::move(*error);
      totals.next = std::max(totals.next, late.end());
      if (account) totals.on_robot = std::min(account->held, totals.lost());
      return totals;
    }
    const RecordBody& body = entry.value()->record.body;
    if (const auto* const frame = std::get_if<RecordedFrame>(&body); frame && !frame->is_late) {
      newest_frame_ns =
          std::max(newest_frame_ns.value_or(frame->capture_time_ns), frame->capture_time_ns);
    }
    const auto* const items = std::get_if<RecordedItems>(&body);
    if (items == nullptr || items->stream != stream.id || items->is_late) continue;
    const auto samples = wire::parse_samples(stream.codec, items->payload);
    if (!samples) continue;
    for (std::uint64_t number = items->first; const Sample& sample : samples.value()) {
      if (auto error = late.take_below(number, hand_on)) return std::move(*error);
      if (newest_frame_ns && sample.time_ns <= *newest_frame_ns) ++totals.behind_frames;
      hand_on(sample);
      ++number;
    }
    totals.next = std::max(totals.next, items->next);
  }
}

std::optional<SessionSummary> read_summary(const fs::path& folder) {
  auto tail = read_tail(folder, summary_of(folder));
  if (!tail || !tail.value()) return std::nullopt;
  return std::move(tail.value()->summary);
}

Result<EncodedFrame> read_images(const fs::path& folder, const RecordedFrame& recorded) {
  const fs::path left = folder / session_names::left_image(recorded.sequence);
  const fs::path right = folder / session_names::right_image(recorded.sequence);
  auto frame = read_frame(recorded, left, right);
  const bool may_be_half_replaced = recorded.is_stereo() && recorded.is_reduced();
  if (!may_be_half_replaced || !frame || is_whole(recorded, frame.value())) return frame;
  for (const auto& [one, other] : {std::pair(left, folder / session_names::kIncomingRight),
                                   std::pair(folder / session_names::kIncoming, right)}) {
    auto completed = read_frame(recorded, one, other);
    if (completed && !completed.value().is_reduced()) return completed;
  }
  return frame;
}

bool are_images_gone(const fs::path& folder, const RecordedFrame& frame) {
  const auto is_gone = [&](const std::string& image) {
    std::error_code failed;
    return !fs::exists(folder / image, failed) && !failed;
  };
  return is_gone(session_names::left_image(frame.sequence)) ||
         (frame.is_stereo() && is_gone(session_names::right_image(frame.sequence)));
}

bool is_whole(const RecordedFrame& recorded, const EncodedFrame& images) {
  if (recorded.is_reduced() && !images.is_reduced()) return true;  // as read_images() found
  if (images.jpeg.size() != recorded.bytes) return false;
  if (!recorded.is_stereo()) return images.jpeg_crc == recorded.crc;
  return images.left_bytes == recorded.left_bytes && crc32(images.left()) == recorded.crc &&
         crc32(images.right()) == recorded.crc_right;
}

FrameFollower::FrameFollower(fs::path folder) : folder_(std::move(folder)) {}

std::optional<Error> FrameFollower::seek(Sequence first) {
  const auto begin = find_segment(folder_, [first](const SessionSummary& summary) {
    return summary.position[wire::kFrames] <= first;
  });
  if (!begin) return begin.error();
  reader_.emplace(folder_, begin.value());
  given_.reset();
  items_.clear();
  return std::nullopt;
}

Result<FramePtr> FrameFollower::next(Sequence first) {
  if (!reader_ || (given_ && first <= *given_)) {
    if (auto error = seek(first)) return std::move(*error);
  }
  for (;;) {
    const auto entry = reader_->next();
    if (!entry) return entry.error();
    if (!entry.value()) return FramePtr();
    const RecordBody& body = entry.value()->record.body;
    const auto* const items = std::get_if<RecordedItems>(&body);
    if (items != nullptr && items->stream >= wire::kFirstOther && !items->is_late) {
      items_.push_back(*items);
    }
    const auto* const recorded = std::get_if<RecordedFrame>(&body);
    if (recorded == nullptr || recorded->is_late) continue;
    if (recorded->sequence < first) items_.clear();
    if (recorded->sequence < first) continue;
    given_ = recorded->sequence;
    auto frame = read_images(folder_, *recorded);
    if (frame) return std::make_shared<const EncodedFrame>(std::move(frame).value());
    log_warn("{}: passed over frame {}: {}", folder_.string(), recorded->sequence,
             frame.error().text);
  }
}

}  // namespace orbbuf
