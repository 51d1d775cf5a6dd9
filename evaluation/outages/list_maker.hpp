// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "bench/sim/mobile_link.hpp"
#include "bench/sim/recorded_sequence.hpp"
#include "bench/sim/simulation.hpp"
#include "bench/sim/stage.hpp"
#include "evaluation/outages/outage_list.hpp"

namespace orbbuf::evaluation {

/// A link without its outage.
struct Link {
  std::string name;
  sim::RateTrace trace;  ///< of one step: a constant rate
  double need = 0;       ///< the mean rate, as a multiple of what the sequence needs
};

/// "constant:RATE" or "FILE:RATE"; RATE is the multiple of the need, FILE a trace
/// (sim::read_trace()) in `traces`. Throws std::runtime_error.
Link read_link(const std::string& text, const std::filesystem::path& traces);

/// Where outages of one length begin, in seconds of what is played.
struct Places {
  std::vector<double> begin_s;
  double played_s =
      0;  ///< how long the sequence must be played at least, back and forth if need be
};

/// `count` evenly spaced ones, from lead_s on. A sequence that is too short for an outage and
/// tail_s behind it is played back and forth, and has the places of one way.
Places place_outages(double sequence_s, double length_s, std::size_t count, double lead_s,
                     double tail_s);

/// Of one outage.
struct OutagePlan {
  double begin_s = 0;
  double length_s = 0;
  double lateness_s = 1;  ///< the stream is to be live again after that
  double lead_s = 3;      ///< the list begins so long before the outage
  double tail_s = 3;      ///< and ends so long after the stream was to be live again
  std::uint64_t seed = 1;
};

/// Makes the lists of a sequence: with each policy of orbbufd, by its own buffer and planner, all
/// equally late.
class ListMaker {
 public:
  /// The policies of orbbufd (kPolicies); `oracle`: which frames, at which quality, a sender would
  /// choose that knows the future; `unbroken`: every frame, without an outage.
  static std::vector<std::string> policies();

  /// `sequence` must outlive it, and be played for at least that long.
  ListMaker(sim::RecordedSequence& sequence, std::vector<std::string> images, std::string sha256,
            double played_s);

  /// A list for each policy, in their order.
  std::vector<OutageList> make(const std::vector<std::string>& policies, const Link& link,
                               const OutagePlan& plan);

 private:
  struct Problem;

  sim::Delivery simulate(const std::string& policy, std::size_t capacity, const Problem& problem);
  std::size_t capacity_for(const Problem& problem);
  static sim::Delivery unbroken(const Problem& problem);
  sim::Delivery by_oracle(const Problem& problem);
  double live_again_s(const sim::Delivery& delivery, const Problem& problem) const;

  sim::RecordedSequence& sequence_;
  const std::vector<std::string> images_;
  const std::string sha256_;
  sim::Stage stage_;
};

}  // namespace orbbuf::evaluation
