// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <vector>

#include "common/drop_record.hpp"
#include "common/frame.hpp"
#include "common/wire.hpp"
#include "daemon/buffer/drop_policy.hpp"
#include "daemon/buffer/reductions.hpp"
#include "daemon/buffer/send_planner.hpp"

namespace orbbuf {

/// The limits on the frames in the buffer.
struct BufferLimits {
  /// Of the waiting frames, >= 3. As many may be in flight, or kMostInFlight if that is more.
  std::size_t frames = std::numeric_limits<std::size_t>::max();
  /// Of JPEG, those in flight included, which take half of it at most.
  std::size_t bytes = std::numeric_limits<std::size_t>::max();
  /// By wait_for_room(), before each frame: then no push gives up one, also if frames have come
  /// back from a connection meanwhile.
  bool is_waited_for = false;
};

/// The robot's frames from capture to acknowledgement, and the count of what became of each.
///
/// When the link is slower than the camera the buffer fills, and each push then costs one frame.
/// The policy chooses it: OrbPolicy gives up the frame whose two neighbours are most alike, so that
/// the remaining frames overlap enough for visual SLAM to keep tracking.
/// Source: Wang et al., "ORBBuf", IROS 2021, arXiv:2010.14861, Sec. III-C and III-D.
///
/// With a SendPlanner (the policy `catch-up`) the choice is made when the network takes a frame:
/// the planner chooses one, and its quality, and the buffer gives up those before it. The buffer is
/// then bounded by bytes, and large; the policy chooses a victim only when it is full. A thread of
/// its own, `reducer`, makes the frames smaller that will probably be taken next. The network does
/// not wait for it: if the link has nothing else to send, the frame goes as it is. The buffer keeps
/// the whole frame until its acknowledgement.
///
/// A frame waits, is taken by the network (in flight), and leaves when the server acknowledges it.
/// If the connection breaks first, the frame returns to the head of the waiting frames, and may be
/// given up. The next connection's server says whether it has the frame (resume()). A drop of such
/// a frame before that is unconfirmed: it is not reported until resume() shows that the server does
/// not have the frame.
///
/// Thread-safe: each function names the thread that calls it. No call blocks another for longer
/// than a pass over the list; the policy runs outside the lock.
/// Memory: a frame, waiting or in flight, costs its JPEG, some 80 KB for 1226x370 pixels in gray at
/// quality 80; and with OrbPolicy, once it has waited behind another, its features, 16 KB for 500.
/// Besides the frames, the lists allocate only when they become longer than they ever were.
/// Invariants: sequence numbers strictly increase from the first in flight to the last waiting;
/// stats() always adds up. After a push all is within the limits, except that the newest frame is
/// always kept, and two frames in flight; returned frames may exceed the limit in frames until the
/// next push.
class FrameBuffer {
 public:
  static constexpr std::size_t kMostInFlight = 32;
  /// Acknowledged frames that resume() can name: eleven minutes of 25 a second, 256 KiB.
  static constexpr std::size_t kMostRemembered = 16384;

  /// limits.frames >= 3, since a policy compares the two neighbours of a frame. Throws
  /// std::invalid_argument below that. `planner` may be null: frames are then taken in order.
  FrameBuffer(BufferLimits limits, std::unique_ptr<DropPolicy> policy,
              std::unique_ptr<SendPlanner> planner = nullptr);

  /// `capture`: a frame was captured. Exactly one push() or on_lost() follows for each.
  void on_captured();
  /// Any thread: a captured frame that will never be pushed (kBusy, kFailed, kShutdown).
  void on_lost(const DropRecord& record);

  /// `worker`: adds the newest frame, and gives up others until the buffer is within its limits.
  /// Never gives up the newest. Does not wait. Calls the policy only if a frame must be given up,
  /// and then takes as long as the policy does.
  void push(FramePtr frame);
  /// `worker`, when it has nothing else to do: DropPolicy::prepare(). True if more work remains.
  /// Does nothing while the link keeps up, which is while at most one frame waits.
  bool prepare();
  /// `worker`: waits until a push gives up no frame. False if `stop` was requested first.
  bool wait_for_room(const std::stop_token& stop);

  /// `main`: hands the oldest frame to the network, or, with a planner, the one that it chooses
  /// (giving up those before it). Null if none waits, or if so much is in flight as may be: then
  /// the server receives frames faster than it brings them onto its device, or not at all; or if
  /// the link is busy and the frame will soon have been made smaller (`reducer`'s `changed`).
  FramePtr take(const SendMoment& moment = {});
  /// `main`, when it cannot take a frame: what would be taken at this moment is made smaller first.
  void look_ahead(const SendMoment& moment);
  /// `main`: the frame taken last is too large for the server (kRefused).
  void refuse_newest();
  /// `main`: the server has acknowledged every frame in flight below `next`.
  void acknowledge(Sequence next);
  /// `main`: the connection broke; the frames in flight return to the head, in order.
  void return_in_flight();
  /// `main`: the server of a new connection has every frame below `next` that was ever taken.
  /// Returned frames below `next` leave; unconfirmed drops below it are undone, others confirmed.
  /// Acknowledged frames from `next` on are dropped as kLost, if they are among the newest
  /// kMostRemembered: the server has lost them.
  void resume(Sequence next);

  /// `main`: the drops that became final since the last call, in that order. Overwrites `drops`,
  /// and keeps its storage for the next call.
  void collect_drops(std::vector<DropRecord>& drops);
  /// `main`, before all else: from here on collect_for_record() has what is to be kept elsewhere.
  void keep_for_record() { has_record_ = true; }
  /// What is new for the robot's record.
  struct ForRecord {
    std::vector<FramePtr> frames;     ///< to be kept: the server may never have them, or not whole
    std::vector<Sequence> delivered;  ///< those of them that it has whole after all, or refuses
    /// Each frame below it was dropped, or acknowledged; the others may still be delivered.
    Sequence first_undelivered = 0;
  };
  /// `main`: the frames that were dropped since the last call, without those that the server
  /// refuses; those that it acknowledged reduced; and, with `those_at_risk`, the undelivered ones
  /// that were here at the last such call, too: a process that is killed loses them. Each frame is
  /// collected once. Overwrites `record`.
  void collect_for_record(ForRecord& record, bool those_at_risk);

  /// `main`: gives up the waiting frames (kShutdown) except those that the server may have: frames
  /// in flight, and returned ones.
  void give_up_waiting();
  /// `main`, at the end: gives up all undelivered frames (kUnknown if the server may have them,
  /// else kShutdown) and makes all drops final.
  void give_up();

  /// Any thread: from here on there is a `reducer`, and take() may wait for its results.
  void expect_reductions();
  /// `reducer`: waits for a frame to be made smaller. Nothing once `stop` is requested.
  std::optional<Reductions::Job> next_to_reduce(const std::stop_token& stop);
  /// `reducer`: what came of the job; null: it cannot be done.
  void on_reduced(const Reductions::Job& job, FramePtr reduced);
  /// Any thread. JPEG's, for the next frame; nothing: as configured.
  std::optional<int> encode_quality() const;

  /// Any thread. A consistent snapshot: captured = the sum of the rest.
  wire::Stats stats() const;
  /// Any thread. A consistent snapshot of the stats, the capacity, the waiting bytes and the count
  /// of frames that could not be made smaller; nothing of the link. If bytes are the limit, the
  /// capacity is the limit in frames of the mean size.
  wire::Report report() const;
  /// Any thread. Capture time of the newest frame that was pushed; 0 before the first.
  std::int64_t last_capture_time_ns() const;

 private:
  struct Entry {
    FramePtr frame;
    double position_s = 0;     ///< PlannedFrame's
    bool was_taken = false;    ///< by a connection that broke; the server may have it
    bool was_reduced = false;  ///< when it was taken last
    bool is_old = false;       ///< it was here when those at risk were collected before
    bool is_kept = false;      ///< it was collected for the record
  };

  struct Delivered {
    Sequence sequence;
    std::int64_t capture_time_ns;
  };

  struct Drop {
    Entry entry;
    std::uint16_t similarity;  ///< DropRecord's
  };

  // All require mutex_.
  wire::Stats current_stats() const;
  bool is_over_limit() const;
  bool may_take() const;
  double next_position(const EncodedFrame& frame);
  std::optional<double> last_position() const;
  std::span<const PlannedFrame> plan_waiting();
  SendPlanner::Choices choose(const SendMoment& moment);
  FramePtr version_of(const SendPlanner::Choice& choice, const SendMoment& moment) const;
  void want_reductions(const SendPlanner::Choices& choices);
  void update_view();
  void drop_if_waiting(const FramePtr& victim, std::uint16_t similarity);
  void drop(Entry& entry, std::uint16_t similarity);
  void count_delivered(Entry& entry);
  void keep(Entry& entry);
  Sequence first_undelivered() const;
  void lose_delivered(Sequence next);

  const BufferLimits limits_;
  const std::unique_ptr<DropPolicy> policy_;  // worker only
  BufferView view_;                           // worker only; empty between calls

  mutable std::mutex mutex_;
  std::condition_variable_any room_;
  // All below guarded by mutex_.
  const std::unique_ptr<SendPlanner> planner_;  // null: frames are taken in order
  std::vector<PlannedFrame> planned_;           // for one call; keeps its storage
  std::condition_variable_any reductions_wanted_;
  Reductions reductions_;
  bool has_reducer_ = false;
  std::uint64_t irreducible_ = 0;  // jobs that could not be done
  std::vector<Entry> waiting_;     // some dozens at most; with a planner, thousands
  std::size_t waiting_bytes_ = 0;  // of their JPEGs
  std::vector<Entry> in_flight_;
  std::size_t in_flight_bytes_ = 0;   // of their JPEGs
  std::vector<Delivered> delivered_;  // the newest acknowledged ones; a ring once it is full
  std::size_t oldest_delivered_ = 0;  // in the ring
  Entry last_acknowledged_;  // the newest of them: the head's neighbour when none is in flight
  std::optional<std::int64_t> last_capture_time_ns_;  // of the last push
  double last_position_s_ = 0;                        // of the same
  std::vector<DropRecord> final_drops_;
  std::vector<Drop> unconfirmed_drops_;  // at most as many as were in flight at once
  bool has_record_ = false;
  ForRecord for_record_;
  wire::Stats counts_;          // waiting and in_flight are taken from the containers, see stats()
  std::uint64_t entering_ = 0;  // captured, neither pushed nor lost yet
};

}  // namespace orbbuf
