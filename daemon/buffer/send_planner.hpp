// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>

namespace orbbuf {

/// What the user asks of the `catch-up` policy (`[link]` of orbbufd.toml).
struct PlanSettings {
  /// After an outage: how long until the newest frame is sent in its turn.
  std::chrono::nanoseconds live_again = std::chrono::seconds(1);
  /// The longest step, from one frame sent to the next, that is made to reach that. Where this is
  /// not enough the stream becomes later instead. At least two frames' time, whatever it says.
  std::chrono::nanoseconds largest_step = std::chrono::milliseconds(250);
};

/// What the sender knows at a moment at which the link can take a frame.
struct SendMoment {
  std::chrono::nanoseconds now{};  ///< on any clock that only grows and keeps its pace
  double bytes_per_s = 0;          ///< what link and server take, measured lately; 0: unknown
  /// Set once nothing more will be captured: what waits may be sent until then.
  std::optional<std::chrono::nanoseconds> end = std::nullopt;
};

/// A waiting frame, as the planner sees it.
struct PlannedFrame {
  /// Where the frame is on the clock that steps are measured on, in seconds. The clock is the
  /// capture time, made to never go back; a simulation may put another in its place.
  double position_s = 0;
  std::size_t bytes = 0;
};

/// Chooses each frame at the moment the link can take it: the policy `catch-up`.
///
/// A buffer that drops frames during an outage decides before it can know how long the outage is,
/// and after it sends every new frame, while few old ones stand for the whole outage. The planner
/// keeps what comes, and when the link is back it spreads the sends that remain until the deadline
/// (the return + live_again) evenly over what was missed and over what is captured meanwhile. It
/// looks for the smallest step with which a chain of frames, from the last one sent to the newest
/// and on, is live by the deadline; it sends that chain's first frame, and plans anew at the next
/// send. docs/design.md ("Choosing when sending") states the problem and what bounds it.
///
/// Not in the paper, whose policies (Sec. III-D) decide when a frame arrives at a full buffer.
/// Knows no clock and no socket. Reentrant. Cost of a choice: about twenty passes over the frames
/// that wait, while more than one does.
class SendPlanner {
 public:
  explicit SendPlanner(PlanSettings settings) : settings_(settings) {}

  /// A frame was captured, that far behind the one before it, and has `bytes`: what is still to
  /// come is expected to be alike.
  void on_captured(double step_s, std::size_t bytes);

  /// The index in `waiting` of the frame to send; those before it are passed over for good. `last`:
  /// the position of the frame sent before; none: nothing was ever sent. Requires a frame waiting.
  std::size_t choose(std::optional<double> last, std::span<const PlannedFrame> waiting,
                     const SendMoment& moment);

  /// Of the frames captured lately; 0 before the first.
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
