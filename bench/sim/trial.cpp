// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/trial.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string_view>
#include <utility>

#include "bench/sim/clairvoyant.hpp"
#include "bench/sim/ideas.hpp"
#include "daemon/buffer/make_policy.hpp"
#include "daemon/buffer/orb_policy.hpp"

namespace orbbuf::sim {
namespace {

constexpr double kBroken = 0.1;  // of M(a, a)

/// The same draw on every platform, which std::uniform_real_distribution does not promise.
double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

/// The very OrbPolicy, with each frame's number for its features and a table for M.
std::unique_ptr<DropPolicy> make_orbbuf(RecordedSequence& sequence) {
  return std::make_unique<OrbPolicy>(
      [](const EncodedFrame& frame, FeatureSet& features) {
        features.descriptors.assign(1, Descriptor{frame.sequence});
      },
      [&sequence](const FeatureSet& a, const FeatureSet& b) {
        return sequence.similarity(a.descriptors[0][0], b.descriptors[0][0]);
      });
}

Window window_of(const RecordedSequence& sequence, const Outage& outage, const Delivery& delivery) {
  Window window{outage.link.outage_begin_ns, outage.link.outage_end_ns};
  const std::vector<std::size_t>& drops = delivery.drops_after;
  if (drops.back() == 0) return window;
  const auto last_drop = std::ranges::lower_bound(drops, drops.back()) - drops.begin();
  const FramePtr& arrival = sequence.frames()[static_cast<std::size_t>(last_drop)];
  window.end_ns = std::max(window.end_ns, arrival->capture_time_ns);
  return window;
}

/// Where even the clairvoyant has nothing left, nobody is behind.
double ratio_of(const Outcome& own, const Outcome& best) {
  if (best.smallest_similarity == 0) return 1;
  return static_cast<double>(own.smallest_similarity) / best.smallest_similarity;
}

void add(Summary& sum, const Outcome& outcome, double broken_below) {
  sum.worst_similarity += outcome.smallest_similarity;
  sum.broken_share += outcome.smallest_similarity < broken_below ? 1 : 0;
  sum.longest_gap += static_cast<double>(outcome.longest_gap);
  sum.epipolar_worst += outcome.smallest_epipolar;
}

void divide(Summary& sum, double count) {
  for (double* value : {&sum.worst_similarity, &sum.broken_share, &sum.longest_gap,
                        &sum.vs_clairvoyant, &sum.epipolar_worst}) {
    *value /= count;
  }
}

}  // namespace

std::vector<Contender> contenders() {
  std::vector<Contender> all;
  all.reserve(kPolicies.size() + kIdeas.size());
  for (const std::string_view name : kPolicies) {
    all.push_back({std::string(name), [name](RecordedSequence& sequence, std::uint64_t seed) {
                     if (name == "orbbuf") return make_orbbuf(sequence);
                     BufferSettings settings;
                     settings.policy = name;
                     settings.seed = seed;
                     return make_policy(settings, [](const EncodedFrame&, FeatureSet&) {});
                   }});
  }
  for (const std::string_view name : kIdeas) {
    all.push_back({"idea-" + std::string(name), [name](RecordedSequence& sequence, std::uint64_t) {
                     return make_idea(name, [&sequence](std::size_t i, std::size_t j) {
                       return sequence.similarity(i, j);
                     });
                   }});
  }
  return all;
}

std::vector<Outage> draw_outages(const RecordedSequence& sequence, std::size_t count_of_each,
                                 std::uint64_t seed) {
  constexpr double kLongestS = 4;
  constexpr double kShortestS = 0.5;
  constexpr double kMarginS = 0.4;  // before and after the outage
  std::mt19937_64 random(seed);
  std::vector<Outage> outages;
  const double interval_s = sequence.mean_interval_ns() * 1e-9;
  const double length_s = interval_s * static_cast<double>(sequence.size() - 1);
  for (const double buffer_s : {0.5, 1.0, 2.0}) {
    for (const double rate : {1.2, 3.0}) {
      for (std::size_t i = 0; i < count_of_each; ++i) {
        const double duration_s = uniform(random, kShortestS, kLongestS);
        const double begin_s = uniform(random, kMarginS, length_s - duration_s - kMarginS);
        Outage& outage = outages.emplace_back();
        outage.capacity =
            static_cast<std::size_t>(std::max(3L, std::lround(buffer_s / interval_s)));
        outage.link = {rate * sequence.mean_jpeg_bytes() / interval_s, std::llround(begin_s * 1e9),
                       std::llround((begin_s + duration_s) * 1e9)};
        outage.seed = random();
      }
    }
  }
  return outages;
}

Outcome judge(RecordedSequence& sequence, const std::vector<std::size_t>& received,
              const Window& window) {
  Outcome outcome{std::numeric_limits<int>::max(), std::numeric_limits<int>::max(), 0};
  for (std::size_t k = 1; k < received.size(); ++k) {
    const std::size_t left = received[k - 1];
    const std::size_t right = received[k];
    if (sequence.frames()[right]->capture_time_ns < window.begin_ns) continue;
    if (sequence.frames()[left]->capture_time_ns > window.end_ns) break;
    outcome.smallest_similarity =
        std::min(outcome.smallest_similarity, sequence.similarity(left, right));
    outcome.smallest_epipolar =
        std::min(outcome.smallest_epipolar, sequence.epipolar_inliers(left, right));
    outcome.longest_gap = std::max(outcome.longest_gap, right - left - 1);
  }
  return outcome;
}

Trial run(RecordedSequence& sequence, const Contender& contender,
          const std::vector<Outage>& outages) {
  const PairSimilarity similarity = [&](std::size_t i, std::size_t j) {
    return sequence.similarity(i, j);
  };
  const double broken_below = kBroken * sequence.self_similarity();
  Trial trial;
  for (const Outage& outage : outages) {
    const Delivery delivery = simulate(sequence.frames(), outage.link, outage.capacity,
                                       contender.make(sequence, outage.seed));
    const Window window = window_of(sequence, outage, delivery);
    const Outcome own = judge(sequence, delivery.received, window);
    const Outcome best = judge(sequence, clairvoyant(delivery, similarity), window);
    add(trial.policy, own, broken_below);
    add(trial.clairvoyant, best, broken_below);
    const double ratio = ratio_of(own, best);
    trial.policy.vs_clairvoyant += ratio;
    trial.clairvoyant.vs_clairvoyant += 1;
    if (delivery.drops_after.back() == 0) continue;
    trial.vs_where_dropped += ratio;
    ++trial.dropped_in;
  }
  if (trial.dropped_in > 0) trial.vs_where_dropped /= static_cast<double>(trial.dropped_in);
  divide(trial.policy, static_cast<double>(outages.size()));
  divide(trial.clairvoyant, static_cast<double>(outages.size()));
  return trial;
}

}  // namespace orbbuf::sim
