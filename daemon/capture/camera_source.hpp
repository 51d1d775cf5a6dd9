// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "common/log.hpp"
#include "common/unique_fd.hpp"
#include "daemon/capture/camera_stream.hpp"
#include "daemon/capture/frame_source.hpp"
#include "daemon/capture/stamp_clock.hpp"

namespace orbbuf {

/// Clocks at one moment: the monotonic one that drivers stamp buffers with, which is Linux's
/// steady_clock and stands still while the machine sleeps, UTC, and for how long it has slept since
/// it was booted.
struct ClockReading {
  std::int64_t monotonic_ns = 0;
  std::int64_t utc_ns = 0;
  std::int64_t asleep_ns = 0;

  std::int64_t since_boot_ns() const { return monotonic_ns + asleep_ns; }  ///< sleep counts
};

/// Within a few microseconds of each other; takes about one.
ClockReading read_clocks();

/// UTC from monotonic times, by an offset that is taken once and then grows only by the time that
/// the machine sleeps, so that steps of the system's clock do not reach into the images' times.
/// Thread-bound.
class CaptureClock {
 public:
  /// Before a time is asked for. True if that changed the offset: at the first reading,
  /// and where the machine has slept since the one before. A frame that was captured before the
  /// sleep and read after it gets the time of a frame from after it.
  bool follow(const ClockReading& now);

  std::int64_t offset_ns() const { return offset_ns_; }
  std::int64_t utc_ns(std::int64_t monotonic_ns) const { return monotonic_ns + offset_ns_; }

 private:
  std::int64_t offset_ns_ = 0;
  std::int64_t asleep_ns_ = 0;
  bool is_started_ = false;
};

/// Counts the frames that are missing in a driver's sequence numbers. Thread-bound.
class GapCounter {
 public:
  /// A stream starts, whose numbers begin anywhere.
  void start() { is_started_ = false; }

  /// How many are missing before the buffer of this number, which wraps around. A driver that does
  /// not count, or begins again, misses nothing.
  std::uint32_t missed_before(std::uint32_t sequence);

 private:
  std::uint32_t last_ = 0;
  bool is_started_ = false;
};

/// A live source that reopens its camera after a failure.
///
/// It closes the camera and reopens it when the camera is unplugged, its driver fails, or no frame
/// comes for 1 s plus three frame intervals (5 s for the first frame). It retries with a back-off
/// of up to 2 s until the camera captures again in the size of its first frames; the session goes
/// on. The back-off starts at 0 again once frames have come for over 2 s. The log has one line for
/// the loss, one for the recovery, and one for each other reason why the camera cannot be opened.
/// If the camera was opened kMostInVain times and sent no frame, the log says what a person can do.
/// Frames missing in the driver's numbering are counted; a buffer that the driver marks as corrupt
/// is a frame with a defect. The destructor logs the counts.
class CameraSource : public FrameSource {
 public:
  static constexpr int kMostInVain = 3;

  /// Opens the camera by `open_camera`, and throws what it throws; reopens by it too. name: the
  /// camera's, for the log. fps: assumed for a camera that reports no rate.
  CameraSource(OpenCamera open_camera, std::string name, double fps);
  ~CameraSource() override;

  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return true; }
  std::string description() const override;
  /// From frame to frame: by the rate that the driver reports, else by the constructor's `fps`.
  std::chrono::nanoseconds frame_time() const;

 private:
  using Clock = std::chrono::steady_clock;

  std::optional<RawFrame> take();
  RawFrame frame_of(const CameraBuffer& buffer);
  void count_missed(std::uint32_t sequence);
  void open();
  void reopen();
  void give_up(const std::string& why);
  void ask_for_help(const std::string& why) const;
  void greet();
  void await_frame_for(std::chrono::nanoseconds limit);
  void wait_until(Clock::time_point deadline, bool for_frame);
  std::chrono::nanoseconds longest_pause() const;

  const OpenCamera open_camera_;
  const std::string name_;
  const double fps_;
  UniqueFd stop_event_;                   // readable once next() has to return
  std::unique_ptr<CameraStream> stream_;  // null: lost, and to be opened again
  CaptureClock clock_;
  StampClock stamps_;
  std::optional<CameraMode> first_mode_;  // whose size the session has
  GapCounter gaps_;
  LogLimit gap_log_{std::chrono::seconds(10)};

  Clock::time_point waiting_since_;
  Clock::time_point deadline_;        // of the next frame, or of the next attempt to open
  Clock::time_point delivers_since_;  // the first frame after the last loss
  Clock::time_point lost_at_;
  std::string why_shut_;  // the last reason that was logged since then
  std::chrono::milliseconds backoff_{0};
  int opened_ = 0;        // since the last frame
  bool is_lost_ = false;  // from give_up() to the first frame after it
  std::uint64_t frames_ = 0;
  std::uint64_t missed_ = 0;
  std::uint64_t corrupt_ = 0;
  std::uint64_t reopened_ = 0;
};

}  // namespace orbbuf
