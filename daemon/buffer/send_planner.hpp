// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/container/static_vector.hpp>
#include <chrono>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>

namespace orbbuf {

/// Predicts the bytes of a JPEG at another quality. They fall as a power of the step between two
/// levels of its quantisation tables, which the quality sets. The exponent is a property of the
/// scene; results correct it. Reentrant.
class SizeModel {
 public:
  /// The bytes at `quality`, as a share of those at quality 50. Both 1..100.
  double share(int quality) const;

  /// An image had `bytes` at quality `from`, and has `reduced_bytes` at `to`, which is lower.
  void learn(double bytes, int from, double reduced_bytes, int to);

 private:
  double exponent_ = 0.69;  // of recorded sequences of cameras, `./dev bench sim`
};

/// The settings of the policy `catch-up` (`[link]` and `[jpeg]` of orbbufd.toml).
struct PlanSettings {
  /// The time after an outage until the newest frame is sent as soon as it is captured.
  std::chrono::nanoseconds live_again = std::chrono::seconds(1);
  /// The longest step, from one frame sent to the next, to reach that. If it is too short for
  /// that, the stream becomes later instead, and if that were half of live_again, the step becomes
  /// up to a quarter longer. Less than two frames' time counts as two.
  std::chrono::nanoseconds largest_step = std::chrono::milliseconds(170);
  /// JPEG's, 1..100: what frames are encoded at, and the lowest at which they may be sent. If both
  /// are equal the planner chooses frames only.
  int quality = 80;
  int least_quality = 80;
};

/// The moment at which the link can take a frame.
struct SendMoment {
  std::chrono::nanoseconds now{};  ///< on any clock that only grows and keeps its pace
  double bytes_per_s = 0;          ///< the measured rate of link and server; 0: unknown
  /// Set when no more frames will be captured: the waiting ones may be sent until then.
  std::optional<std::chrono::nanoseconds> end = std::nullopt;
  /// The link still has something to send, so that a frame may be a few milliseconds late.
  bool is_busy = false;
};

/// What the planner knows of a waiting frame.
struct PlannedFrame {
  /// The frame's time on the clock that measures steps, in seconds: the capture time, changed so
  /// that it never goes back. A simulation may use another clock.
  double position_s = 0;
  std::size_t bytes = 0;
  int quality = 0;  ///< of its JPEG; 0: unknown, which counts as PlanSettings::quality
};

/// Chooses each frame, and its quality, at the moment the link can take it: the policy `catch-up`.
///
/// A buffer that drops frames during an outage decides before it knows how long the outage is.
/// After the outage it sends every new frame, and few frames of the outage. With the planner the
/// buffer keeps all frames. When the link is back, the planner spreads the sends until the deadline
/// (the return + live_again) evenly over the waiting frames and those captured meanwhile. It finds
/// the smallest step with which a chain of frames, from the last one sent to the newest and beyond,
/// is live by the deadline if each is sent at the least quality; and then the highest quality at
/// which this chain still is. It sends the chain's first frame, and repeats the search at the next
/// send. docs/design.md ("Choosing when sending") states the problem and its bounds.
///
/// A frame that waits alone is sent at the highest quality that the link carries in the time of one
/// frame. When the link has carried less than the frames need for a second, new frames are to be
/// encoded at a lower quality: encode_quality().
///
/// Not in the paper, whose policies (Sec. III-D) decide when a frame arrives at a full buffer.
/// Has no clock and no socket. Reentrant. Cost of a choice: about thirty passes over the waiting
/// frames if there are two or more.
class SendPlanner {
 public:
  /// A frame to send, by its index in `waiting`.
  struct Choice {
    std::size_t index = 0;
    int quality = 0;  ///< less than its own; 0: as it is

    friend bool operator==(const Choice&, const Choice&) = default;
  };
  /// The choice, and what will probably be chosen next, as far as those frames wait.
  using Choices = boost::container::static_vector<Choice, 3>;

  explicit SendPlanner(PlanSettings settings);

  /// A frame was captured, `step_s` after the one before it. The planner expects the same of later
  /// frames. Does not look at frame.position_s.
  void on_captured(double step_s, const PlannedFrame& frame);

  /// What to send of `waiting`, at least one frame; the caller gives up the frames before the first
  /// choice. `last`: the position of the frame sent before; none: no frame was sent yet.
  Choices choose(std::optional<double> last, std::span<const PlannedFrame> waiting,
                 const SendMoment& moment);
  /// What choose() would say.
  Choices look_ahead(std::optional<double> last, std::span<const PlannedFrame> waiting,
                     const SendMoment& moment) const {
    return SendPlanner(*this).choose(last, waiting, moment);
  }
  /// The frame that was chosen is being sent, as `bytes`.
  void on_sent(std::size_t bytes, const SendMoment& moment);

  /// `frame` was made into a JPEG of `bytes` at `quality`.
  void on_reduced(const PlannedFrame& frame, std::size_t bytes, int quality);
  /// Whether JPEGs of these qualities differ by so few bytes that there is no use in making one
  /// from the other.
  bool is_close(int quality, int other) const;
  /// How much earlier the link is free if `frame` is sent at that quality, in seconds.
  double saved_s(const PlannedFrame& frame, int quality, const SendMoment& moment) const;

  /// What new frames are to be encoded at, for the link as it is for good.
  int encode_quality() const { return encode_quality_; }
  /// Expected of the frames to come; 0 before the first.
  double mean_bytes() const { return mean_size_ * sizes_.share(encode_quality_); }

 private:
  struct Plan;
  struct Chain;

  void look_for_return(std::size_t waiting, const SendMoment& moment);
  void note_phase(std::span<const PlannedFrame> waiting, const SendMoment& moment);
  void adapt_encoding(const SendMoment& moment);
  std::size_t first_to_send(std::span<const PlannedFrame> waiting) const;
  Plan next_plan(double last, std::span<const PlannedFrame> waiting, const SendMoment& moment);
  Plan plan_within(double horizon_s, double last, std::span<const PlannedFrame> waiting,
                   const SendMoment& moment) const;
  Chain chain(const Plan& plan, double horizon_s, double last,
              std::span<const PlannedFrame> waiting, const SendMoment& moment) const;
  double whole_frames(double step_s) const;
  int own_quality(const PlannedFrame& frame) const;
  int fitting_quality(const PlannedFrame& frame, const SendMoment& moment) const;
  int highest_quality(double share) const;
  int reduced_quality(const PlannedFrame& frame, int quality) const;

  const PlanSettings settings_;
  SizeModel sizes_;
  double interval_s_ = 0;  // between captured frames, lately
  double mean_size_ = 0;   // of the latest frames captured, in bytes at quality 50
  double offset_s_ = std::numeric_limits<double>::max();  // of moments from positions when new
  double next_capture_s_ = 0;                             // from now, as far as is known
  std::optional<std::chrono::nanoseconds> deadline_;      // to be live by; none while live
  double largest_so_far_s_ = 0;                           // step that was needed since it was set
  int least_so_far_;                                      // quality that was
  std::optional<std::chrono::nanoseconds> last_choice_;
  double expected_s_ = 0;  // until the choice after that one
  int encode_quality_;
  std::optional<std::chrono::nanoseconds> unfit_since_;  // for the link
};

}  // namespace orbbuf
