// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>

namespace orbbuf {

/// The settings of the policy `catch-up` (`[link]` of orbbufd.toml).
struct PlanSettings {
  /// The time after an outage until the newest frame is sent as soon as it is captured.
  std::chrono::nanoseconds live_again = std::chrono::seconds(1);
  /// The longest step, from one frame sent to the next, to reach that. If it is too short for
  /// that, the stream becomes later instead. Less than two frames' time counts as two.
  std::chrono::nanoseconds largest_step = std::chrono::milliseconds(250);
};

/// The moment at which the link can take a frame.
struct SendMoment {
  std::chrono::nanoseconds now{};  ///< on any clock that only grows and keeps its pace
  double bytes_per_s = 0;          ///< the measured rate of link and server; 0: unknown
  /// Set when no more frames will be captured: the waiting ones may be sent until then.
  std::optional<std::chrono::nanoseconds> end = std::nullopt;
};

/// What the planner knows of a waiting frame.
struct PlannedFrame {
  /// The frame's time on the clock that measures steps, in seconds: the capture time, changed so
  /// that it never goes back. A simulation may use another clock.
  double position_s = 0;
  std::size_t bytes = 0;
};

/// Chooses each frame at the moment the link can take it: the policy `catch-up`.
///
/// A buffer that drops frames during an outage decides before it knows how long the outage is.
/// After the outage it sends every new frame, and few frames of the outage. With the planner the
/// buffer keeps all frames. When the link is back, the planner spreads the sends until the deadline
/// (the return + live_again) evenly over the waiting frames and those captured meanwhile. It finds
/// the smallest step with which a chain of frames, from the last one sent to the newest and beyond,
/// is live by the deadline. It sends that chain's first frame, and repeats the search at the next
/// send. docs/design.md ("Choosing when sending") states the problem and its bounds.
///
/// Not in the paper, whose policies (Sec. III-D) decide when a frame arrives at a full buffer.
/// Has no clock and no socket. Reentrant. Cost of a choice: about twenty passes over the waiting
/// frames if there are two or more.
class SendPlanner {
 public:
  explicit SendPlanner(PlanSettings settings) : settings_(settings) {}

  /// A frame of `bytes` was captured, `step_s` after the one before it. The planner expects the
  /// same of later frames.
  void on_captured(double step_s, std::size_t bytes);

  /// The index in `waiting` of the frame to send; the caller gives up those before it. `last`: the
  /// position of the frame sent before; none: no frame was sent yet. Requires a frame waiting.
  std::size_t choose(std::optional<double> last, std::span<const PlannedFrame> waiting,
                     const SendMoment& moment);

  /// Of the latest frames captured; 0 before the first.
  double mean_bytes() const { return mean_bytes_; }

 private:
  struct Chain;

  void look_for_return(std::size_t waiting, const SendMoment& moment);
  std::size_t first_to_send(std::span<const PlannedFrame> waiting) const;
  void note_phase(std::span<const PlannedFrame> waiting, const SendMoment& moment);
  double next_step(double last, std::span<const PlannedFrame> waiting, const SendMoment& moment);
  double smallest_step(double last, std::span<const PlannedFrame> waiting, double horizon_s,
                       const SendMoment& moment) const;
  Chain chain(double last, std::span<const PlannedFrame> waiting, double step_s, double horizon_s,
              const SendMoment& moment) const;

  const PlanSettings settings_;
  double interval_s_ = 0;  // between captured frames, lately
  double mean_bytes_ = 0;
  double offset_s_ = std::numeric_limits<double>::max();  // of moments from positions when new
  double next_capture_s_ = 0;                             // from now, as far as is known
  std::optional<std::chrono::nanoseconds> deadline_;      // to be live by; none while live
  double largest_so_far_s_ = 0;                           // step that was needed since it was set
  std::optional<std::chrono::nanoseconds> last_choice_;
  double expected_s_ = 0;  // until the choice after that one
};

}  // namespace orbbuf
