// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "common/log_limit.hpp"
#include "common/unique_fd.hpp"
#include "daemon/capture/camera_clock.hpp"
#include "daemon/capture/camera_stream.hpp"
#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

/// A camera, of whatever kind, that is kept alive.
///
/// Once it has delivered, it does not give up. When it is unplugged, its driver fails, or no frame
/// comes for 1 s and three frames' time (5 s for a first one), it is closed and opened again, after
/// a while that grows to 2 s, until it is back and films in the size of its first frames: one line
/// in the log each way, one for each other reason than that it is not there, and the session goes
/// on. That while is 0 again only once frames have come for over 2 s. Frames that the driver
/// numbered but did not give are counted; a buffer that the driver calls corrupt is a frame with a
/// defect. At the end the log has the account.
class CameraSource : public FrameSource {
 public:
  /// Opens the camera, and throws as `open_camera` does, which is kept to open it again. name:
  /// which camera, in the log. fps: assumed of a camera that does not say its rate.
  CameraSource(OpenCamera open_camera, std::string name, double fps);
  ~CameraSource() override;

  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return true; }
  std::string description() const override;
  /// From frame to frame: as the driver has it, else as the constructor was told.
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

  const OpenCamera open_camera_;
  const std::string name_;
  const double fps_;
  UniqueFd stop_event_;                   // readable once next() has to return
  std::unique_ptr<CameraStream> stream_;  // null: lost, and to be opened again
  CaptureClock clock_;
  std::optional<CameraMode> first_mode_;  // whose size the session has
  GapCounter gaps_;
  LogLimit gap_log_{std::chrono::seconds(10)};

  Clock::time_point waiting_since_;
  Clock::time_point deadline_;        // of the next frame, or of the next attempt to open
  Clock::time_point delivers_since_;  // the first frame after the last loss
  Clock::time_point lost_at_;
  std::string why_shut_;  // the last reason that was logged since then
  std::chrono::milliseconds backoff_{0};
  bool is_lost_ = false;  // from give_up() to the first frame after it
  std::uint64_t frames_ = 0;
  std::uint64_t missed_ = 0;
  std::uint64_t corrupt_ = 0;
  std::uint64_t reopened_ = 0;
};

}  // namespace orbbuf
