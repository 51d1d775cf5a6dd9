// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "common/log_limit.hpp"
#include "common/unique_fd.hpp"
#include "daemon/capture/frame_source.hpp"
#include "daemon/capture/make_source.hpp"
#include "daemon/capture/v4l2_clock.hpp"

namespace orbbuf {

struct CameraBuffer;
class V4l2Stream;

/// A camera of the kernel's (V4L2): USB, CSI with a plain driver, or simulated.
///
/// Once it has delivered, it does not give up. When it is unplugged, its driver fails, or no frame
/// comes for 1 s and three frames' time (5 s for a first one), it is closed and opened again, after
/// a while that grows to 2 s, until it is back: one line in the log each way, and the session goes
/// on. Frames that the driver numbered but did not give are counted; a buffer that the driver calls
/// corrupt is a frame with a defect. At the end the log has the account.
class V4l2Source : public FrameSource {
 public:
  /// Starts filming, with device, format, size, rate and controls of `settings`. Throws
  /// std::runtime_error as V4l2Stream does.
  explicit V4l2Source(SourceSettings settings);
  ~V4l2Source() override;

  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return true; }
  std::string description() const override;
  /// From frame to frame: as the driver has it, else as settings.fps.
  std::chrono::nanoseconds frame_time() const;

 private:
  using Clock = std::chrono::steady_clock;

  std::optional<RawFrame> take();
  RawFrame frame_of(const CameraBuffer& buffer);
  void count_missed(std::uint32_t sequence);
  void open();
  void reopen();
  void give_up(const std::string& why);
  void greet();
  void await_frame_for(std::chrono::nanoseconds limit);
  void wait_until(Clock::time_point deadline, bool for_frame);
  std::chrono::nanoseconds longest_pause() const;

  const SourceSettings settings_;
  UniqueFd stop_event_;                 // readable once next() has to return
  std::unique_ptr<V4l2Stream> stream_;  // null: lost, and to be opened again
  CaptureClock clock_;
  GapCounter gaps_;
  LogLimit gap_log_{std::chrono::seconds(10)};

  Clock::time_point waiting_since_;
  Clock::time_point deadline_;  // of the next frame, or of the next attempt to open
  Clock::time_point lost_at_;
  std::chrono::milliseconds backoff_{0};
  bool is_lost_ = false;  // from give_up() to the first frame after it
  std::uint64_t frames_ = 0;
  std::uint64_t missed_ = 0;
  std::uint64_t corrupt_ = 0;
  std::uint64_t reopened_ = 0;
};

}  // namespace orbbuf
