// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>

#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

/// Gives a finite source that waits for its reader a camera's manners: pace and no end.
///
/// In real time, a frame is handed out when as much time has gone by since the first one as lies
/// between their capture times; gaps are waited for as they are, and a late reader is not waited
/// for: what is overdue comes at once. Frames with a defect keep their place.
class ReplaySource : public FrameSource {
 public:
  struct Options {
    bool is_realtime = true;
    bool is_looped = false;  ///< after the last frame the first again, capture times going on
    /// In real time, the first frame has the time of day. The next one is made half a nominal
    /// interval after the last one: a camera does not compete with the work on its frames.
    bool is_like_camera = false;
    std::int64_t nominal_interval_ns = 40'000'000;  ///< before the repeat of a single frame, too
  };

  /// Opens a source at its beginning. May throw, as FrameSource::next() may.
  using Open = std::function<std::unique_ptr<FrameSource>()>;

  /// Calls `open` once now, and again at each repeat. A repeat's first frame comes one mean
  /// interval of the last round after that round's last.
  ReplaySource(Open open, const Options& options);

  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return options_.is_realtime; }
  std::string description() const override;

 private:
  std::optional<RawFrame> take(const std::stop_token& stop);
  void reopen();
  void wait_until_due(std::int64_t capture_time_ns, const std::stop_token& stop);

  Open open_;
  Options options_;
  std::unique_ptr<FrameSource> source_;

  /// The round being replayed: capture times as handed out, which are the source's plus offset_ns_.
  std::int64_t frames_in_round_ = 0;
  std::int64_t round_begin_ns_ = 0;
  std::int64_t round_end_ns_ = 0;
  std::int64_t offset_ns_ = 0;
  bool is_repeat_ = false;

  /// The moment that corresponds to a capture time; set by the first frame.
  struct Anchor {
    std::chrono::steady_clock::time_point moment;
    std::int64_t capture_time_ns;
  };
  std::optional<Anchor> anchor_;

  std::mutex
      mutex_;  ///< guards nothing: the condition, which only a stop or time fulfils, needs it
  std::condition_variable_any stopped_;
};

}  // namespace orbbuf
