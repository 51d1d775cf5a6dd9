// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bench/sim/recorded_sequence.hpp"
#include "bench/sim/simulation.hpp"
#include "daemon/buffer/drop_policy.hpp"

namespace orbbuf::sim {

/// A policy under trial. A new one for every outage; `seed` is for those that draw lots.
struct Contender {
  std::string name;
  std::function<std::unique_ptr<DropPolicy>(RecordedSequence& sequence, std::uint64_t seed)> make;
};

/// The five policies of orbbufd and the ideas of ideas.hpp. They use the sequence's remembered
/// similarities instead of computing them again.
std::vector<Contender> contenders();

/// One outage: how long a buffer, how fast and when dead a link.
struct Outage {
  std::size_t capacity = 0;
  LinkModel link;
  std::uint64_t seed = 0;
};

/// `count` outages of 0.5 to 4 s, evenly spread over buffers of 0.5, 1 and 2 s and rates of 1.2 and
/// 3 times the mean need, which begin and end within the sequence. The same for the same seed.
std::vector<Outage> draw_outages(const RecordedSequence& sequence, std::size_t count_of_each,
                                 std::uint64_t seed);

/// The frames that an outage could have cost: captured from its beginning to its end, or to the
/// last drop if that came later.
struct Window {
  std::int64_t begin_ns = 0;
  std::int64_t end_ns = 0;
};

/// What came through of a window, the frames on either side of it included.
struct Outcome {
  int smallest_similarity = 0;
  int smallest_epipolar = 0;
  std::size_t longest_gap = 0;  ///< frames in a row that are missing
};

Outcome judge(RecordedSequence& sequence, const std::vector<std::size_t>& received,
              const Window& window);

/// Over many outages: means, but for the share.
struct Summary {
  double worst_similarity = 0;  ///< of the smallest similarity between neighbours
  double broken_share = 0;      ///< of outages in which it is under 10 % of M(a, a)
  double longest_gap = 0;       ///< frames in a row that are missing
  double vs_clairvoyant = 0;    ///< of the ratio of the smallest similarity to the clairvoyant's
  double epipolar_worst = 0;    ///< of the smallest number of epipolar inliers
};

struct Trial {
  Summary policy;
  Summary clairvoyant;          ///< with the opportunities that this policy had
  double vs_where_dropped = 0;  ///< vs_clairvoyant of the outages that cost a frame at all
  std::size_t dropped_in = 0;   ///< how many of them did
};

Trial run(RecordedSequence& sequence, const Contender& contender,
          const std::vector<Outage>& outages);

}  // namespace orbbuf::sim
