// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bench/sim/recorded_sequence.hpp"
#include "evaluation/odometry/frames.hpp"
#include "evaluation/odometry/reference_vo.hpp"

namespace orbbuf::evaluation {

/// Calls work(i) for i from 0 to count - 1 on as many threads as there are processors, with
/// progress under this name. An exception ends it and is thrown on.
void for_each_parallel(const std::string& name, std::size_t count,
                       const std::function<void(std::size_t)>& work);

/// Frames in a row, by index.
struct Stretch {
  std::size_t begin = 0;
  std::size_t end = 0;  ///< one behind
};

/// What a real process has delivered.
struct Session {
  std::string name;  ///< CONTENDER@RUN
  std::string contender;
  std::string run;
  std::vector<std::size_t> received;
};

/// named: CONTENDER@RUN=FOLDER, with a times.txt in it. Throws std::runtime_error.
Session read_session(const std::string& named);

/// An outage is scored from so many seconds before it to so many after it: the link needs one to
/// catch up.
inline constexpr double kScoredBeforeS = 1;
inline constexpr double kScoredAfterS = 2;

/// When a link was cut and when it was mended, counted in frames from the beginning.
struct Outage {
  double begin = 0;
  double end = 0;
};

/// The frames that an outage is scored by: from 1 s before it to 2 s behind the first frame that
/// was captured after it and arrived. Nothing if none arrived: all is lost.
std::optional<Stretch> stretch_around(const Outage& outage, std::span<const std::size_t> received,
                                      double fps, std::size_t frames);

/// Most frames of the stretch that are missing in a row, those at its ends too.
std::size_t longest_gap(std::span<const std::size_t> received, const Stretch& stretch);

/// A folder of orbbuf-world in memory: for the policies as orbbufd would have it, for the reference
/// VO as images, and the reference VO as it was every kCheckpoint frames of the unbroken sequence.
class Scene {
 public:
  static constexpr std::size_t kCheckpoint = 25;

  /// Reads everything and tracks the unbroken sequence. 0.6 MB a frame of 640x480.
  explicit Scene(const std::filesystem::path& folder);

  std::size_t size() const { return images_.size(); }
  double fps() const { return 1e9 / sequence_.mean_interval_ns(); }
  sim::RecordedSequence& sequence() { return sequence_; }
  const TrackingResult& unbroken() const { return checkpoints_.back().result(); }
  const Camera& camera() const { return camera_; }

  /// How far the camera has really gone and turned between two frames, 10 degrees as a metre.
  double motion_m(std::size_t i, std::size_t j) const;

  /// Runs the reference VO on these frames, up to but without frame `end`, or until it is lost.
  /// Goes on from the last checkpoint before the first frame that is missing. Thread-safe.
  TrackingResult track(const std::vector<std::size_t>& received, std::size_t end) const;

  /// How far the part of a trajectory within the stretch is from the truth.
  TrajectoryError error(const Trajectory& trajectory, const Stretch& stretch) const;

  /// True if the reference VO places the last frames of the stretch, was never lost on the way, and
  /// the path over it is no more than three times as wrong as the unbroken sequence's, or no more
  /// than 2 % of it. Frames before the stretch all arrived. Thread-safe.
  bool survives(const std::vector<std::size_t>& received, const Stretch& stretch) const;

  /// How wrong the path is, as far as the reference VO has placed its frames, as a multiple of the
  /// whole unbroken one's. Infinite if it is lost, or has placed none of the sequence's last
  /// second, which is so if none of it arrived: after the last frame the link has all the time that
  /// it needs. Thread-safe.
  double ate_ratio(const std::vector<std::size_t>& received) const;

  /// All frames, but of the stretch only those listed.
  std::vector<std::size_t> only_in(const std::vector<std::size_t>& received,
                                   const Stretch& stretch) const;

 private:
  Camera camera_;
  Trajectory truth_;
  std::vector<ListedFrame> list_;
  std::vector<GrayFrame> images_;
  sim::RecordedSequence sequence_;
  std::vector<ReferenceVo>
      checkpoints_;  ///< [i]: before frame i * kCheckpoint; the last: at the end
};

}  // namespace orbbuf::evaluation
