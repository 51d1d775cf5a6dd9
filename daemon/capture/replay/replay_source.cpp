// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/replay_source.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "common/watched_thread.hpp"

namespace orbbuf {

using std::chrono::nanoseconds;
using std::chrono::steady_clock;

namespace {

/// Longer than any wait, short enough to be added to any time point.
constexpr nanoseconds kLongestWait = std::chrono::years(100);

}  // namespace

ReplaySource::ReplaySource(Open open, const Options& options)
    : open_(std::move(open)), options_(options), source_(open_()) {}

std::optional<RawFrame> ReplaySource::next(std::stop_token stop) {
  if (options_.is_realtime && options_.is_like_camera && anchor_) {
    wait_until_due(round_end_ns_ + options_.nominal_interval_ns / 2, stop);
  }
  auto frame = take(stop);
  if (!frame) return std::nullopt;
  if (options_.is_realtime) {
    wait_until_due(frame->capture_time_ns, stop);
    if (stop.stop_requested()) return std::nullopt;
  }
  return frame;
}

/// The next frame, from the next round if need be, its time shifted to where the round is.
std::optional<RawFrame> ReplaySource::take(const std::stop_token& stop) {
  auto frame = source_->next(stop);
  if (!frame && options_.is_looped && !stop.stop_requested()) {
    reopen();
    frame = source_->next(stop);
    if (!frame && !stop.stop_requested()) {
      throw std::runtime_error("cannot loop " + source_->description() + ": it has no frames now");
    }
  }
  if (!frame) return std::nullopt;
  if (frames_in_round_++ == 0) {
    if (is_repeat_) {
      offset_ns_ = round_begin_ns_ - frame->capture_time_ns;
    } else if (options_.is_realtime && options_.is_like_camera) {
      const nanoseconds now = std::chrono::system_clock::now().time_since_epoch();
      offset_ns_ = now.count() - frame->capture_time_ns;
    }
    round_begin_ns_ = frame->capture_time_ns + offset_ns_;
  }
  frame->capture_time_ns += offset_ns_;
  round_end_ns_ = frame->capture_time_ns;
  return frame;
}

void ReplaySource::reopen() {
  source_ = open_();
  const auto mean_interval_ns = frames_in_round_ > 1
                                    ? (round_end_ns_ - round_begin_ns_) / (frames_in_round_ - 1)
                                    : options_.nominal_interval_ns;
  round_begin_ns_ = round_end_ns_ + std::max<std::int64_t>(mean_interval_ns, 1);
  frames_in_round_ = 0;
  is_repeat_ = true;
}

void ReplaySource::wait_until_due(std::int64_t capture_time_ns, const std::stop_token& stop) {
  if (!anchor_) anchor_ = {steady_clock::now(), capture_time_ns};
  const auto since_anchor = nanoseconds(capture_time_ns - anchor_->capture_time_ns);
  std::unique_lock lock(mutex_);
  const auto due = anchor_->moment + std::min(since_anchor, kLongestWait);
  while (steady_clock::now() < due && !stop.stop_requested()) {
    beat();
    stopped_.wait_until(lock, stop, std::min(due, steady_clock::now() + kBeatInterval),
                        [] { return false; });
  }
}

std::string ReplaySource::description() const {
  return source_->description() + (options_.is_realtime ? ", in real time" : "") +
         (options_.is_looped ? ", looped" : "");
}

}  // namespace orbbuf
