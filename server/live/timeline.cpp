// SPDX-License-Identifier: Apache-2.0
#include "server/live/timeline.hpp"

#include <algorithm>

#include "common/decimal.hpp"

namespace orbbuf {
namespace {

using std::chrono::nanoseconds;

constexpr std::chrono::seconds kSilence{1};
constexpr std::chrono::milliseconds kLate{500};
constexpr std::chrono::minutes kMinute{1};
constexpr std::uint64_t kMostParts = 2 * Timeline::kSeconds;
/// Differences of times up to that can be subtracted, too. It is the year 2067.
constexpr std::int64_t kLatest = std::numeric_limits<std::int64_t>::max() / 3;

}  // namespace

void Timeline::on_heard(Time now, bool is_new) {
  if (heard_ != Time{} && now - heard_ >= kSilence) {
    silent_since_ = heard_;
    is_silence_over_ = true;
  }
  is_after_connect_ = is_after_connect_ || is_new;
  heard_ = now;
}

void Timeline::on_delivered(std::int64_t capture_time_ns, Time now) {
  const nanoseconds capture(std::clamp(capture_time_ns, -kLatest, kLatest));
  const nanoseconds delay = note_offset(now.time_since_epoch() - capture, now);
  if (is_silence_over_ && (is_after_connect_ || delay >= kLate)) {
    outages_.push_back({robot_time(silent_since_), robot_time(now)});
    if (outages_.size() > kOutages) outages_.pop_front();
  }
  is_silence_over_ = is_after_connect_ = false;
  newest_ = capture;
  TimelineSecond& second = *second_of(capture.count(), true);
  ++second.delivered;
  const auto delay_ms = std::chrono::duration_cast<std::chrono::milliseconds>(delay).count();
  second.delay_ms =
      std::max(second.delay_ms, static_cast<std::uint32_t>(std::clamp<std::int64_t>(
                                    delay_ms, 0, std::numeric_limits<std::uint32_t>::max())));
  second.changed = now;
}

/// In at most kMostParts parts, since a robot may claim any number of frames.
void Timeline::on_dropped(const DropRecord& record, Time now) {
  const std::uint64_t part = (record.frames - 1) / kMostParts + 1;
  for (std::uint64_t done = 0; done < record.frames; done += std::min(part, record.frames - done)) {
    const std::int64_t time_ns = record.capture_time_of(record.sequence + done);
    TimelineSecond* const second = second_of(std::clamp(time_ns, -kLatest, kLatest), false);
    if (second == nullptr) continue;
    second->dropped += static_cast<std::uint32_t>(std::min(part, record.frames - done));
    second->similarity = std::min(second->similarity, record.similarity);
    second->changed = now;
  }
}

nanoseconds Timeline::robot_time(Time time) const {
  const nanoseconds offset = std::min(offset_, offset_before_);
  return offset == kNone ? nanoseconds(0) : time.time_since_epoch() - offset;
}

std::optional<nanoseconds> Timeline::age(Time now) const {
  if (!newest_) return std::nullopt;
  return robot_time(now) - *newest_;
}

/// How much later than the fastest a frame of that `offset` comes. What was least long ago does not
/// count forever, since clocks drift and are set.
nanoseconds Timeline::note_offset(nanoseconds offset, Time now) {
  if (now - minute_ >= kMinute) {
    minute_ = now;
    offset_before_ = offset_;
    offset_ = kNone;
  }
  offset_ = std::min(offset_, offset);
  return offset - std::min(offset_, offset_before_);
}

/// Null for what is too old. A frame in order that is far from the others shows that the robot's
/// clock was set: the others no longer mean anything.
TimelineSecond* Timeline::second_of(std::int64_t capture_time_ns, bool is_in_order) {
  const std::int64_t second = split_seconds(capture_time_ns).seconds;
  const std::int64_t newest = seconds_.empty() ? second : seconds_.back().second;
  const bool is_far = second > newest + kSeconds || second <= newest - kSeconds;
  if (is_far && !is_in_order) return nullptr;
  if (is_far) seconds_.clear();
  const auto after = std::ranges::upper_bound(seconds_, second, {}, &TimelineSecond::second);
  if (after != seconds_.begin() && std::prev(after)->second == second) return &*std::prev(after);
  seconds_.insert(after, TimelineSecond{second});
  while (seconds_.back().second - seconds_.front().second >= kSeconds) seconds_.pop_front();
  return &*std::ranges::lower_bound(seconds_, second, {}, &TimelineSecond::second);
}

}  // namespace orbbuf
