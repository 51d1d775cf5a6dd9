// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "common/log.hpp"
#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

enum class Side : std::uint8_t { kLeft, kRight };

/// Finds which frames of two cameras were captured together, by RawFrame::monotonic_ns. Frames of a
/// side come in the order of their times; the sides may be some frames ahead of each other. A frame
/// that can have no partner any more is given up and counted. Pure; reentrant.
class StereoPairer {
 public:
  /// What a side may be ahead of the other, in frames: the oldest beyond that is given up, so that
  /// a camera that is gone does not fill the memory.
  static constexpr std::size_t kMostWaiting = 4;

  /// tolerance: how far apart the images of a pair may be.
  explicit StereoPairer(std::chrono::nanoseconds tolerance) : tolerance_(tolerance) {}

  /// The pair that `frame` completes: the left frame, with the right one within it.
  std::optional<RawFrame> add(Side side, RawFrame frame);

  std::uint64_t pairs() const { return pairs_; }
  /// Given up; what still waits is not counted.
  std::uint64_t unpaired(Side side) const { return sides_.at(index(side)).unpaired; }
  std::chrono::nanoseconds tolerance() const { return tolerance_; }

 private:
  struct Waiting {
    std::deque<RawFrame> frames;  // of one side at most, by time
    std::uint64_t unpaired = 0;

    void give_up_first();
  };
  static std::size_t index(Side side) { return static_cast<std::size_t>(side); }

  const std::chrono::nanoseconds tolerance_;
  std::array<Waiting, 2> sides_;
  std::uint64_t pairs_ = 0;
};

/// Two live cameras as one source: each captures on its own thread, `left` and `right`, and two
/// images captured together are one frame with the left image's time.
///
/// The cameras need not be synchronised: images up to `tolerance` apart are a pair. Images
/// without a partner are counted, logged at most every 10 s, and summed up in the log at the end.
/// While one camera is missing (CameraSource waits for it) no frame comes.
class StereoSource : public FrameSource {
 public:
  /// Both sources set RawFrame::monotonic_ns. tolerance: half a frame's time, so that every image
  /// has one partner.
  StereoSource(std::unique_ptr<FrameSource> left, std::unique_ptr<FrameSource> right,
               std::chrono::nanoseconds tolerance);
  /// Stops the cameras and waits for their threads.
  ~StereoSource() override;

  /// Throws what a camera threw. Ends when both have, or with `stop`, which ends them too.
  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return true; }
  std::string description() const override { return description_; }

 private:
  void capture(Side side, const std::stop_token& stop);
  void add(Side side, RawFrame frame);

  const std::unique_ptr<FrameSource> left_;
  const std::unique_ptr<FrameSource> right_;
  const std::string description_;

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  StereoPairer pairer_;          // guarded by mutex_
  std::deque<RawFrame> pairs_;   // guarded by mutex_
  std::uint64_t overtaken_ = 0;  // guarded by mutex_: pairs that next() did not take in time
  std::uint64_t logged_ = 0;     // guarded by mutex_: images without a partner that were logged
  LogLimit unpaired_log_{std::chrono::seconds(10)};  // guarded by mutex_
  int capturing_ = 2;                                // guarded by mutex_
  std::exception_ptr failure_;                       // guarded by mutex_

  std::jthread left_thread_;
  std::jthread right_thread_;
};

}  // namespace orbbuf
