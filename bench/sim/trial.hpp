// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bench/sim/fifo_oracle.hpp"
#include "bench/sim/recorded_sequence.hpp"
#include "bench/sim/simulation.hpp"
#include "bench/sim/stage.hpp"

namespace orbbuf::sim {

inline constexpr int kQuality = 80;  ///< at which frames are encoded, if nothing asks for less
inline constexpr int kLeastQuality = 20;

/// What a contender may need to know of a run.
struct Setup {
  std::size_t capacity = 25;  ///< frames; of all but the planner
  std::chrono::nanoseconds live_again = std::chrono::seconds(1);  ///< the planner's
  std::chrono::nanoseconds largest_step = std::chrono::milliseconds(170);
  std::uint64_t seed = 1;                            ///< for those that draw lots
  int least_quality = kQuality;                      ///< the planner's
  BytesAt bytes_at;                                  ///< sizes of frames at lower qualities
  double interval_s = 0.04;                          ///< from frame to frame
  PairSimilarity similarity;                         ///< M of frames by their sequence numbers
  const std::vector<FramePtr>* stand_ins = nullptr;  ///< SimulatedBuffer's
};

/// A policy under trial. A new buffer for every run.
struct Contender {
  std::string name;
  std::function<SimulatedBuffer(const Setup&)> make;
  bool may_reduce = false;  ///< to be compared with the oracle that chooses qualities, too
};

/// The policies of orbbufd, and baselines: `catch-up-full`, which makes no frame smaller;
/// `catch-up-Q`, the same with every frame encoded at quality Q; `catch-up-steered`, the same with
/// an encoder that sets the quality of new frames by rate and backlog, as that of a video call
/// does; and `afr`. They take similarities from the setup instead of computing them.
std::vector<Contender> contenders();
/// The one of that name. Throws std::invalid_argument if there is none.
Contender contender(std::string_view name);

/// Those that an oracle may choose from: kQuality down to kLeastQuality.
std::span<const int> oracle_qualities();

/// One outage: how long a buffer, how fast and when dead a link.
struct Outage {
  double buffer_s = 0;
  double rate = 0;  ///< of the mean need
  std::size_t capacity = 0;
  LinkModel link;
  std::uint64_t seed = 0;
};

/// `count_of_each` outages of 0.5 to 4 s for each buffer and rate, which begin and end within the
/// sequence. The same for the same seed.
std::vector<Outage> draw_outages(const RecordedSequence& sequence,
                                 const std::vector<double>& buffers_s,
                                 const std::vector<double>& rates, std::size_t count_of_each,
                                 std::uint64_t seed);

/// What came through of an outage, from the last frame before it until half a second after the
/// stream was live again.
struct OutageStats {
  double longest_gap = 0;          ///< frames in a row that are missing
  double largest_step_s = 0;       ///< from one frame to the next
  double largest_motion = 0;       ///< the same in image motion, as a share of the width
  double smallest_similarity = 0;  ///< between neighbours
  double jump = 0;                 ///< largest change of image motion from one step to the next
  double live_again_s = 0;         ///< from the link's return
  double mean_quality = 0;         ///< of the frames sent from the return on
  double least_quality = 0;
  double bytes = 0;  ///< from the return until 2 s after the lateness asked for
  /// What the oracle that may choose at every send reaches at this lateness, or at the one asked
  /// for if that is more, over what was reached: of the time step, of the motion step; and of M
  /// the other way round. At most 1.
  double vs_oracle = 0;
  double vs_oracle_motion = 0;
  double vs_oracle_similarity = 0;
  /// The least quality over that of the oracle, with the oracle's step.
  double vs_oracle_quality = 0;
  /// Of orbbuf only: its smallest similarity over that of oracle-fifo.
  double vs_fifo_oracle = 0;
};

/// One contender, in every outage. The oracles have nothing beside oracles.
struct Column {
  std::string name;
  std::vector<OutageStats> runs;
};

/// Every contender through every outage. The planner is given as live_again what drop-oldest needs
/// in the same outage; its clocks are contenders of their own: catch-up-motion, catch-up-both. Last
/// come the oracles: `oracle` may choose frames and qualities at every send and goes by time;
/// oracle-time, oracle-motion, oracle-m may choose frames only and go by one measure each;
/// oracle-fifo has the opportunities of orbbuf and goes by M.
std::vector<Column> run(Stage& stage, const std::vector<Outage>& outages);

}  // namespace orbbuf::sim
