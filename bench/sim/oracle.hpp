// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "bench/sim/simulation.hpp"

namespace orbbuf::sim {

/// What it costs to send frame j right after frame i; finite.
using StepCost = std::function<double(std::size_t i, std::size_t j)>;

/// A link that is back after an outage, as one sees it who knows the future. Frames are named by
/// their index.
struct OracleProblem {
  std::span<const FramePtr> frames;  ///< by capture time
  FinishTime finish;
  /// Of each frame that is sent after `last`. Null: those of its JPEG.
  std::function<std::size_t(std::size_t frame)> bytes = nullptr;
  std::size_t last = 0;            ///< the frame whose send began last before the outage
  std::int64_t last_begin_ns = 0;  ///< and when that was
  std::size_t last_bytes = 0;      ///< that were sent of it; 0: its JPEG
  std::int64_t deadline_ns = 0;    ///< to be live by: to begin to send the newest captured frame
};

/// The frames to send after `last`, up to the first that is live.
struct OraclePath {
  double largest_cost = 0;
  std::vector<std::size_t> frames;
  std::vector<std::int64_t> begin_ns;
};

/// Of all that could be sent from `last` on, any captured frame at any send, the path that is live
/// by the deadline and whose largest step costs least, to within `tolerance`. Nothing if none is
/// live by then.
///
/// It bounds every policy that is live by the deadline: for a bound on the cost of a step the
/// earliest time at which frame j can begin is f(j) = max(capture(j), min over i of the end of a
/// send of i that begins at f(i)), over all i < j with a step i to j within the bound. The link is
/// a FIFO: who begins earlier does not end later; so to be early never harms, and nothing but the
/// earliest times need be known. The smallest bound is found by bisection. docs/design.md has the
/// proof.
/// `is_monotone`: cost(i, j) does not rise with i, as on a clock; saves most of the time.
std::optional<OraclePath> oracle(const OracleProblem& problem, const StepCost& cost,
                                 bool is_monotone, double tolerance);

/// A path whose frames are all sent at one quality.
struct QualityPath {
  OraclePath path;
  int quality = 0;
};

/// The same in two dimensions: the path whose largest step costs least if every frame may be sent
/// at the lowest of `qualities`, and of those paths the one whose lowest quality is highest. Some
/// path whose frames are all of one quality is among the best: to send a frame at less than its
/// quality, down to the path's lowest, makes no begin later.
/// `qualities`: falling, at least one. problem.bytes does not count.
std::optional<QualityPath> oracle(OracleProblem problem, const BytesAt& bytes_at,
                                  std::span<const int> qualities, const StepCost& cost,
                                  bool is_monotone, double tolerance);

}  // namespace orbbuf::sim
