// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "bench/sim/recorded_sequence.hpp"

namespace orbbuf::sim {

/// A recorded sequence played forwards and backwards in turns until it is long enough, so that an
/// outage near its end can be watched until the robot has caught up; and clocks for its steps.
/// Frames are named by their index in what is played.
class Stage {
 public:
  /// `sequence` must outlive the stage.
  Stage(RecordedSequence& sequence, double shortest_s);

  /// frames()[i]->sequence is i; capture times begin at 0. The bytes of a JPEG are not those of the
  /// image, but as many.
  const std::vector<FramePtr>& frames() const { return frames_; }

  /// Which of the sequence's frames frame i is.
  std::size_t origin(std::size_t i) const { return origin_[i]; }
  /// M of frames i and j.
  int similarity(std::size_t i, std::size_t j) {
    return sequence_.similarity(origin_[i], origin_[j]);
  }
  /// Of frame i, at that quality.
  std::size_t bytes_at(std::size_t i, int quality) const {
    return sequence_.bytes_at(origin_[i], quality);
  }
  double time_s(std::size_t i) const {
    return 1e-9 * static_cast<double>(frames_[i]->capture_time_ns);
  }
  /// How far the image has moved up to frame i: the sum of image_motion() over neighbours.
  double motion(std::size_t i) const { return motion_[i]; }

  /// frames() with capture times on the clock of the image's motion, which is made to go as far as
  /// time does over the whole sequence.
  const std::vector<FramePtr>& by_motion() const { return by_motion_; }
  /// The same, but each step is the larger of the two: of time and of motion.
  const std::vector<FramePtr>& by_both() const { return by_both_; }

 private:
  RecordedSequence& sequence_;
  std::vector<std::size_t> origin_;
  std::vector<FramePtr> frames_;
  std::vector<double> motion_;
  std::vector<FramePtr> by_motion_;
  std::vector<FramePtr> by_both_;
};

}  // namespace orbbuf::sim
