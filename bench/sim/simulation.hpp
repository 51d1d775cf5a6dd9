// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "bench/sim/link_model.hpp"
#include "common/frame.hpp"
#include "daemon/buffer/drop_policy.hpp"
#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/buffer/send_planner.hpp"

namespace orbbuf::sim {

/// What a link and a policy made of a sequence. Frames are named by their sequence numbers.
struct Delivery {
  std::vector<std::size_t> received;      ///< in order
  std::vector<std::int64_t> begin_ns;     ///< when the send of received[k] began
  std::vector<std::int64_t> end_ns;       ///< and when its last byte had passed
  std::vector<std::size_t> drops_before;  ///< how many had been dropped when received[k] was taken
  std::vector<std::size_t> drops_after;   ///< how many, once arrival T had been pushed
  std::vector<int> quality{};             ///< at which received[k] was sent
  std::vector<std::size_t> bytes{};       ///< and its size
};

/// When the last of `bytes` has passed a link, if the first may set out at `start_ns`.
using FinishTime = std::function<std::int64_t(std::int64_t start_ns, std::size_t bytes)>;

/// The size of a frame, by its sequence number, at a quality.
using BytesAt = std::function<std::size_t(std::size_t frame, int quality)>;

/// What a FrameBuffer is made of, and what only a simulation knows.
struct SimulatedBuffer {
  BufferLimits limits;
  std::unique_ptr<DropPolicy> policy;
  std::unique_ptr<SendPlanner> planner = nullptr;
  /// Asked before a frame is pushed, with the number of frames that wait; false: the frame is
  /// dropped at once. Null: every frame is pushed. For baselines that refuse frames.
  std::function<bool(std::size_t waiting)> admits = nullptr;
  /// What is pushed instead of frame i: the same number and size, the capture time on another
  /// clock, for a planner that goes by it. Null: the frame itself. Must outlive the simulation.
  const std::vector<FramePtr>* stand_ins = nullptr;
  /// With it, frames that wait are made smaller, at no cost of time. Null: none is.
  BytesAt reduced_bytes = nullptr;
  /// JPEG's for the frame captured now, lower than the frame's own, given the bytes that wait and
  /// the measured rate; needs encoded_bytes. Null: as the buffer asks for.
  std::function<int(std::uint64_t waiting_bytes, double bytes_per_s)> encode_quality = nullptr;
  /// With it, frames are encoded at the quality that is asked for. Null: at their own.
  BytesAt encoded_bytes = nullptr;
  /// What the planner is given of the link's measured rate: 1 is the truth as far as it is known.
  double believed_rate = 1;
};

inline std::int64_t to_ns(double seconds) { return std::llround(seconds * 1e9); }
inline double to_s(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

/// From the link's return to the first send that begins with the newest of `captured`; nothing:
/// none does. `sent` (frames by their index in `captured`) and `begin_ns` as in Delivery.
std::optional<double> live_again_s(std::span<const FramePtr> captured,
                                   std::span<const std::size_t> sent,
                                   std::span<const std::int64_t> begin_ns, std::int64_t return_ns);

/// Runs the daemon's own FrameBuffer on a virtual clock: every frame arrives at its capture time,
/// the link takes one whenever the last one has passed, `worker` has the time to prepare between
/// two arrivals, and the daemon's own LinkRate measures the rate that a planner is given.
Delivery simulate(const std::vector<FramePtr>& frames, const FinishTime& finish,
                  SimulatedBuffer buffer);
/// The same over a link with one outage.
Delivery simulate(const std::vector<FramePtr>& frames, const LinkModel& link,
                  SimulatedBuffer buffer);

}  // namespace orbbuf::sim
