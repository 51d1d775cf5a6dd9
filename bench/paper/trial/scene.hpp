// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "bench/paper/judge/frames.hpp"
#include "bench/paper/judge/verdict.hpp"
#include "bench/sim/recorded_sequence.hpp"

namespace orbbuf::paper {

/// Calls work(i) for i from 0 to count - 1 on as many threads as there are processors, with
/// progress under this name. An exception ends it and is thrown on.
void for_each_parallel(const std::string& name, std::size_t count,
                       const std::function<void(std::size_t)>& work);

/// Frames in a row, by index.
struct Stretch {
  std::size_t begin = 0;
  std::size_t end = 0;  ///< one behind
};

/// A folder of orbbuf-world in memory: for the policies as orbbufd would have it, for the judge as
/// images, and the judge as it was every kCheckpoint frames of the unbroken sequence.
class Scene {
 public:
  static constexpr std::size_t kCheckpoint = 25;

  /// Reads everything and judges the unbroken sequence. 0.6 MB a frame of 640x480.
  explicit Scene(const std::filesystem::path& folder);

  std::size_t size() const { return images_.size(); }
  double fps() const { return 1e9 / sequence_.mean_interval_ns(); }
  sim::RecordedSequence& sequence() { return sequence_; }
  const Verdict& unbroken() const { return checkpoints_.back().verdict(); }
  const Camera& camera() const { return camera_; }

  /// How far the camera has really gone and turned between two frames, 10 degrees as a metre.
  double motion_m(std::size_t i, std::size_t j) const;

  /// The judge on these frames, up to but without frame `end`; it stops where it is lost. Goes on
  /// from the last checkpoint before the first frame that is missing. Thread-safe.
  Verdict judge(const std::vector<std::size_t>& received, std::size_t end) const;

  /// How far the part of a trajectory within the stretch is from the truth.
  TrajectoryError error(const Trajectory& trajectory, const Stretch& stretch) const;

  /// True if the judge places the last frames of the stretch, was never lost on the way, and the
  /// path over it is no more than three times as wrong as the unbroken sequence's, or no more than
  /// 2 % of it. Frames before the stretch all arrived. Thread-safe.
  bool survives(const std::vector<std::size_t>& received, const Stretch& stretch) const;

  /// All frames, but of the stretch only those listed.
  std::vector<std::size_t> only_in(const std::vector<std::size_t>& received,
                                   const Stretch& stretch) const;

 private:
  Camera camera_;
  Trajectory truth_;
  std::vector<ListedFrame> list_;
  std::vector<JudgedFrame> images_;
  sim::RecordedSequence sequence_;
  std::vector<Judge> checkpoints_;  ///< [i]: before frame i * kCheckpoint; the last: at the end
};

}  // namespace orbbuf::paper
