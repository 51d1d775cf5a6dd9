// SPDX-License-Identifier: Apache-2.0
#include "daemon/spool/segment_queue.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace orbbuf {
namespace {

constexpr std::uint64_t kAll = std::numeric_limits<std::uint64_t>::max();

/// The sessions of a robot follow each other, so the last is nearly always the one.
void add(std::vector<SegmentQueue::Lost>& sessions, const std::string& session_id,
         const FrameRange& range) {
  if (range.frames == 0) return;
  const auto found = std::find_if(sessions.rbegin(), sessions.rend(), [&](const auto& session) {
    return session.session_id == session_id;
  });
  if (found != sessions.rend()) return found->range.add(range);
  sessions.push_back({session_id, range});
}

}  // namespace

FrameRange SegmentQueue::Segment::held() const {
  if (!is_loaded) return unloaded;
  FrameRange held;
  for (std::size_t index = gone_before; index < entries.size(); ++index) {
    if (!entries[index].is_gone) held.add(entries[index].record.sequence);
  }
  return held;
}

void SegmentQueue::Segment::drop(std::size_t index) {
  entries[index].is_gone = true;
  while (gone_before < entries.size() && entries[gone_before].is_gone) ++gone_before;
}

/// Whether it held the frame.
bool SegmentQueue::Segment::skip(Sequence sequence) {
  for (std::size_t index = entries.size(); index-- > gone_before;) {
    if (entries[index].record.sequence != sequence || entries[index].is_gone) continue;
    drop(index);
    skipped.insert(sequence);
    return true;
  }
  return false;
}

/// Where the first record begins that is held.
std::uint64_t SegmentQueue::Segment::free_end() const {
  if (!is_loaded) return freed_below;
  if (gone_before < entries.size()) return entries[gone_before].record.offset;
  return entries.empty() ? 0 : entries.back().record.end();
}

void SegmentQueue::Segment::unload() {
  records = entries.size();
  unloaded = held();
  freed_below = free_end();
  is_loaded = false;
  std::vector<Entry>().swap(entries);
  gone_before = 0;
}

void SegmentQueue::add_complete(const SegmentHeader& header, std::uint64_t bytes,
                                const FrameRange& range, std::uint64_t freed_below) {
  Segment segment;
  segment.number = header.number;
  segment.bytes = bytes;
  segment.session_id = header.session_id;
  segment.is_complete = true;
  segment.records = range.frames;
  segment.unloaded = range;
  segment.freed_below = freed_below;
  segments_.push_back(std::move(segment));
  last_number_ = header.number;
}

void SegmentQueue::add_foreign(std::uint64_t number, std::uint64_t bytes) {
  Segment segment;
  segment.number = number;
  segment.bytes = bytes;
  segment.is_foreign = segment.is_complete = true;
  segments_.push_back(std::move(segment));
  last_number_ = number;
}

void SegmentQueue::begin(std::uint64_t number, std::uint64_t bytes) {
  Segment segment;
  segment.number = number;
  segment.bytes = bytes;
  segment.session_id = session_id_;
  segment.is_loaded = true;
  segments_.push_back(std::move(segment));
  last_number_ = number;
}

void SegmentQueue::add_record(const SegmentRecord& record, bool is_forgotten) {
  Segment& segment = segments_.back();
  segment.entries.push_back({record});
  segment.bytes = record.end();
  if (is_forgotten) segment.skip(record.sequence);
}

void SegmentQueue::complete(std::uint64_t bytes) {
  Segment& segment = segments_.back();
  segment.bytes = bytes;
  segment.is_complete = true;
  if (!is_needed(segment)) segment.unload();
}

SegmentQueue::Segment* SegmentQueue::find(std::uint64_t number) {
  const auto found = std::lower_bound(
      segments_.begin(), segments_.end(), number,
      [](const Segment& segment, std::uint64_t other) { return segment.number < other; });
  return found != segments_.end() && found->number == number ? &*found : nullptr;
}

std::deque<SegmentQueue::Segment>::const_iterator SegmentQueue::oldest() const {
  return std::find_if(segments_.begin(), segments_.end(),
                      [](const Segment& segment) { return !segment.is_foreign; });
}

bool SegmentQueue::is_needed(const Segment& segment) const {
  return segment.number <= read_number_ || segment.number == forgot_number_ ||
         &segment == &*oldest();
}

std::optional<std::uint64_t> SegmentQueue::to_load() const {
  for (const Segment& segment : segments_) {
    if (segment.is_foreign || segment.is_loaded) continue;
    if (is_needed(segment) || !segment.to_forget.empty()) return segment.number;
  }
  return std::nullopt;
}

std::uint64_t SegmentQueue::load(std::uint64_t number, const std::vector<SegmentRecord>& records) {
  Segment* const segment = find(number);
  if (segment == nullptr || segment->is_loaded) return 0;
  segment->is_loaded = true;
  segment->entries.reserve(records.size());
  for (const SegmentRecord& record : records) segment->entries.push_back({record});
  for (std::size_t index = 0; index < records.size(); ++index) {
    const SegmentRecord& record = records[index];
    const bool is_freed = record.offset < segment->freed_below;
    if (is_freed || segment->skipped.contains(record.sequence)) segment->drop(index);
  }
  for (const Sequence sequence : std::exchange(segment->to_forget, {})) segment->skip(sequence);
  const std::uint64_t before = segment->records;
  if (!is_needed(*segment)) {  // it was loaded to forget a frame, and others may follow
    Segment* const last = find(std::exchange(forgot_number_, number));
    if (last != nullptr && last->is_loaded && !is_needed(*last)) last->unload();
  }
  return before - std::min<std::uint64_t>(before, records.size());
}

std::optional<SegmentQueue::Place> SegmentQueue::to_read() {
  for (const Segment& segment : segments_) {
    if (segment.is_foreign || segment.number < read_number_) continue;
    if (segment.number > read_number_) {
      read_number_ = segment.number;
      read_index_ = 0;
    }
    if (!segment.is_loaded) return std::nullopt;
    const auto& entries = segment.entries;
    read_index_ = std::max(read_index_, segment.gone_before);
    while (read_index_ < entries.size() && entries[read_index_].is_gone) ++read_index_;
    if (read_index_ < entries.size())
      return Place{read_number_, read_index_, entries[read_index_].record};
    if (!segment.is_complete) return std::nullopt;
  }
  return std::nullopt;
}

bool SegmentQueue::put(const Place& place, FramePtr frame) {
  if (place.number != read_number_ || place.index != read_index_) return true;
  ++read_index_;
  Segment* const segment = find(place.number);
  if (segment == nullptr || segment->entries[place.index].is_gone) return true;
  if (!frame) return !segment->skip(place.record.sequence);
  ready_.push_back({place.number, place.index, {segment->session_id, std::move(frame)}});
  return true;
}

std::optional<SpooledFrame> SegmentQueue::next() {
  if (ready_.empty()) return std::nullopt;
  Ready ready = std::move(ready_.front());
  ready_.pop_front();
  const auto& [session_id, frame] = ready.frame;
  handed_out_.push_back({ready.number, ready.index, session_id, frame->sequence});
  return std::move(ready.frame);
}

void SegmentQueue::acknowledge(std::uint64_t frames) {
  for (; frames > 0 && !handed_out_.empty(); --frames) {
    const HandedOut& oldest = handed_out_.front();
    if (Segment* const segment = find(oldest.number)) segment->drop(oldest.index);
    handed_out_.pop_front();
  }
}

std::vector<SegmentQueue::Lost> SegmentQueue::rewind() {
  std::vector<Lost> lost;
  for (const HandedOut& frame : handed_out_) {
    if (frame.is_evicted) add(lost, frame.session_id, {1, frame.sequence, frame.sequence});
  }
  handed_out_.clear();
  ready_.clear();
  read_number_ = 0;
  read_index_ = 0;
  return lost;
}

void SegmentQueue::forget(Sequence sequence) {
  std::erase_if(ready_, [&](const Ready& ready) {
    return ready.frame.frame->sequence == sequence && ready.frame.session_id == session_id_;
  });
  for (HandedOut& frame : handed_out_) {
    if (frame.sequence == sequence && frame.session_id == session_id_) frame.is_evicted = false;
  }
  for (Segment& segment : segments_) {
    if (segment.is_foreign || segment.session_id != session_id_) continue;
    if (segment.is_loaded && segment.skip(sequence)) return;
  }
  for (Segment& segment : segments_) {
    const bool may_hold =
        !segment.is_foreign && !segment.is_loaded && segment.unloaded.covers(sequence);
    if (may_hold && segment.session_id == session_id_) segment.to_forget.insert(sequence);
  }
}

std::optional<std::uint64_t> SegmentQueue::take_finished() {
  const auto found = std::find_if(segments_.begin(), segments_.end(), [](const Segment& segment) {
    if (segment.is_foreign || !segment.is_complete) return false;
    return segment.is_loaded ? segment.gone_before == segment.entries.size()
                             : segment.unloaded.frames == 0;
  });
  if (found == segments_.end()) return std::nullopt;
  const std::uint64_t number = found->number;
  segments_.erase(found);
  return number;
}

std::optional<SegmentQueue::Evicted> SegmentQueue::evict_frames() {
  const auto found = oldest();
  if (found == segments_.end() || !found->is_complete) return std::nullopt;
  return take_out(static_cast<std::size_t>(found - segments_.cbegin()));
}

std::optional<SegmentQueue::Evicted> SegmentQueue::evict() {
  const auto foreign = std::find_if(segments_.begin(), segments_.end(),
                                    [](const Segment& segment) { return segment.is_foreign; });
  if (foreign == segments_.end()) return evict_frames();
  return take_out(static_cast<std::size_t>(foreign - segments_.begin()));
}

SegmentQueue::Evicted SegmentQueue::take_out(std::size_t index) {
  Segment& segment = segments_[index];
  for (HandedOut& frame : handed_out_) {
    if (frame.number != segment.number || segment.entries[frame.index].is_gone) continue;
    frame.is_evicted = true;
    segment.drop(frame.index);
  }
  std::erase_if(ready_, [&](const Ready& ready) { return ready.number == segment.number; });
  Evicted evicted{segment.number, {segment.session_id, segment.held()}};
  segments_.erase(segments_.begin() + static_cast<std::ptrdiff_t>(index));
  return evicted;
}

SpoolCursor SegmentQueue::cursor() const {
  const auto segment = oldest();
  if (segment == segments_.end()) return {last_number_, kAll};
  return {segment->number, segment->free_end()};
}

std::uint64_t SegmentQueue::bytes() const {
  std::uint64_t bytes = 0;
  for (const Segment& segment : segments_) bytes += segment.bytes;
  return bytes;
}

std::uint64_t SegmentQueue::frames() const {
  std::uint64_t frames = 0;
  for (const auto& session : held()) frames += session.range.frames;
  return frames;
}

std::vector<SegmentQueue::Lost> SegmentQueue::held() const {
  std::vector<Lost> sessions;
  for (const HandedOut& frame : handed_out_) {
    if (frame.is_evicted) add(sessions, frame.session_id, {1, frame.sequence, frame.sequence});
  }
  for (const Segment& segment : segments_) {
    if (!segment.is_foreign) add(sessions, segment.session_id, segment.held());
  }
  return sessions;
}

std::size_t SegmentQueue::sessions() const { return held().size(); }

}  // namespace orbbuf
