// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "bench/sim/fifo_oracle.hpp"
#include "bench/sim/mobile_link.hpp"
#include "bench/sim/simulation.hpp"

namespace orbbuf::sim {

/// What came of a whole stream.
struct StreamStats {
  double delivered = 0;    ///< share of the frames
  double longest_gap = 0;  ///< frames in a row that are missing
  double late_p50_s = 0;   ///< age of a frame when its last byte had passed
  double late_p95_s = 0;
  double late_worst_s = 0;
};

/// Of the frames from `first_s` on.
StreamStats measure_stream(const std::vector<FramePtr>& frames, const Delivery& delivery,
                           double first_s = 0);

/// The recorded links in `traces`, each scaled to a mean of what the stream needs, and the mahimahi
/// ones as they are too, under a stream of 25 frames of 40 kB a second: every policy, and the
/// planner with other bounds on its step and with whole frames only. Then links that are too slow,
/// with a wrong rate, or dead again while the stream catches up. Prints tables; returns RESULT
/// lines. `share`: of a frame's bytes, what is left at a quality. `similarity`: what orbbuf is
/// given, since there are no images.
std::string try_links(const std::filesystem::path& traces,
                      const std::function<double(int quality)>& share,
                      const PairSimilarity& similarity);

}  // namespace orbbuf::sim
