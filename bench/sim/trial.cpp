// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/trial.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "bench/sim/afr_policy.hpp"
#include "bench/sim/oracle.hpp"
#include "daemon/buffer/make_policy.hpp"
#include "daemon/buffer/orb_policy.hpp"
#include "daemon/buffer/simple_policies.hpp"

namespace orbbuf::sim {
namespace {

constexpr double kLeadS = 3;           // simulated before the outage, for the rate to be known
constexpr double kJudgedAfterS = 0.5;  // the stream is live again
constexpr double kCarriedS = 2;        // the same, when bytes are counted
constexpr double kLongestTailS = 20;   // simulated after the outage
constexpr auto kUnbounded = std::chrono::seconds(1000);
constexpr double kSameTimeS = 1e-6;
constexpr double kSameMotion = 1e-6;

/// The same draw on every platform, which std::uniform_real_distribution does not promise.
double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

/// The very OrbPolicy, with each frame's number for its features and a table for M.
std::unique_ptr<DropPolicy> make_orbbuf(const PairSimilarity& similarity) {
  return std::make_unique<OrbPolicy>(
      [](const EncodedFrame& frame, FeatureSet& features) {
        features.descriptors.assign(1, Descriptor{frame.sequence});
      },
      [similarity](const FeatureSet& a, const FeatureSet& b) {
        return similarity(a.descriptors[0][0], b.descriptors[0][0]);
      });
}

/// The planner; it makes no frame smaller.
SimulatedBuffer make_full(const Setup& setup, int least_quality = kQuality) {
  SimulatedBuffer buffer{{}, std::make_unique<UniformPolicy>()};
  buffer.planner = std::make_unique<SendPlanner>(
      PlanSettings{setup.live_again, setup.largest_step, kQuality, least_quality});
  buffer.stand_ins = setup.stand_ins;
  return buffer;
}

/// Every frame is encoded at that quality.
Contender fixed(int quality) {
  return {fmt::format("catch-up-{}", quality), [quality](const Setup& setup) {
            SimulatedBuffer buffer = make_full(setup);
            buffer.encoded_bytes = setup.bytes_at;
            buffer.encode_quality = [quality](auto...) { return quality; };
            return buffer;
          }};
}

/// Frames are encoded such that they and what waits can be sent within live_again, but at not less
/// than the least quality.
SimulatedBuffer make_steered(const Setup& setup) {
  SimulatedBuffer buffer = make_full(setup);
  buffer.encoded_bytes = setup.bytes_at;
  buffer.encode_quality = [setup](std::uint64_t waiting_bytes, double bytes_per_s) {
    const double live_s = 1e-9 * static_cast<double>(setup.live_again.count());
    const double room = bytes_per_s - static_cast<double>(waiting_bytes) / live_s;
    int quality = kQuality;
    const auto need = [&] {
      return static_cast<double>(setup.bytes_at(0, quality)) / setup.interval_s;
    };
    while (bytes_per_s > 0 && quality > setup.least_quality && need() > room) --quality;
    return quality;
  };
  return buffer;
}

SimulatedBuffer make_shipped(std::string_view name, const Setup& setup) {
  if (name == "orbbuf") return {{.frames = setup.capacity}, make_orbbuf(setup.similarity)};
  if (name == "catch-up") {
    SimulatedBuffer buffer = make_full(setup, setup.least_quality);
    buffer.reduced_bytes = buffer.encoded_bytes = setup.bytes_at;
    return buffer;
  }
  BufferSettings settings;
  settings.policy = name;
  settings.seed = setup.seed;
  return {{.frames = setup.capacity}, make_policy(settings, [](const auto&, auto&) {})};
}

SimulatedBuffer make_afr(const Setup& setup) {
  auto policy = std::make_unique<AfrPolicy>(setup.capacity);
  AfrPolicy& afr = *policy;
  SimulatedBuffer buffer{{.frames = setup.capacity}, std::move(policy)};
  buffer.admits = [&afr](std::size_t waiting) { return afr.admits(waiting); };
  return buffer;
}

/// What was sent after an outage. Element 0 and 1 went before it.
struct Sent {
  std::vector<std::size_t> frames;
  std::vector<std::int64_t> begin_ns;
  std::vector<int> quality;
};

/// One outage on a stage.
class Run {
 public:
  Run(Stage& stage, const Outage& outage)
      : stage_(stage), outage_(outage), finish_([this](std::int64_t start_ns, std::size_t bytes) {
          return outage_.link.finish(start_ns, bytes);
        }) {
    const Contender fifo{"drop-oldest",
                         [](const Setup& setup) { return make_shipped("drop-oldest", setup); }};
    cut(kLongestTailS);
    reference_ = sent(simulate(fifo));
    asked_s_ = live_again_s(reference_).value_or(kLongestTailS);
    cut(asked_s_ + kCarriedS);
  }

  Delivery simulate(const Contender& contender, const std::vector<FramePtr>* stand_ins = nullptr) {
    Setup setup;
    setup.capacity = outage_.capacity;
    setup.live_again = std::chrono::nanoseconds(to_ns(asked_s_));
    setup.largest_step = kUnbounded;
    setup.seed = outage_.seed;
    setup.least_quality = kLeastQuality;
    setup.bytes_at = bytes_at();
    setup.interval_s = stage_.time_s(1) - stage_.time_s(0);
    setup.similarity = similarity();
    setup.stand_ins = stand_ins;
    return sim::simulate(frames_, finish_, contender.make(setup));
  }

  PairSimilarity similarity() {
    return [this](std::size_t i, std::size_t j) { return stage_.similarity(i, j); };
  }

  BytesAt bytes_at() const {
    return [this](std::size_t frame, int quality) { return stage_.bytes_at(frame, quality); };
  }

  /// From the two last sends before the link's return.
  Sent sent(const Delivery& delivery) const {
    const auto first = std::ranges::lower_bound(delivery.begin_ns, outage_.link.outage_end_ns) -
                       delivery.begin_ns.begin();
    const auto from = std::max<std::ptrdiff_t>(0, first - 2);
    return {{delivery.received.begin() + from, delivery.received.end()},
            {delivery.begin_ns.begin() + from, delivery.begin_ns.end()},
            {delivery.quality.begin() + from, delivery.quality.end()}};
  }

  Sent sent(const OraclePath& path, int quality = kQuality) const {
    Sent all = before_return(reference_);
    all.frames.insert(all.frames.end(), path.frames.begin(), path.frames.end());
    all.begin_ns.insert(all.begin_ns.end(), path.begin_ns.begin(), path.begin_ns.end());
    all.quality.resize(all.frames.size(), quality);
    return all;
  }

  OutageStats measure(const Sent& sent) {
    OutageStats stats;
    stats.smallest_similarity = std::numeric_limits<double>::max();
    stats.least_quality = kQuality;
    double count = 0;
    stats.live_again_s = live_again_s(sent).value_or(kLongestTailS);
    const std::int64_t carried_until_ns = outage_.link.outage_end_ns + to_ns(asked_s_ + kCarriedS);
    const std::int64_t end_ns = judged_until_ns(stats);
    for (std::size_t k = 1; k < sent.frames.size() && sent.begin_ns[k] <= end_ns; ++k) {
      if (sent.begin_ns[k] < outage_.link.outage_end_ns) continue;
      const std::size_t i = sent.frames[k - 1];
      const std::size_t j = sent.frames[k];
      const double motion = stage_.motion(j) - stage_.motion(i);
      const auto largest = [](double& value, double other) { value = std::max(value, other); };
      largest(stats.longest_gap, static_cast<double>(j - i - 1));
      ++count;
      stats.mean_quality += sent.quality[k];
      stats.least_quality = std::min(stats.least_quality, static_cast<double>(sent.quality[k]));
      largest(stats.largest_step_s, stage_.time_s(j) - stage_.time_s(i));
      largest(stats.largest_motion, motion);
      stats.smallest_similarity =
          std::min(stats.smallest_similarity, static_cast<double>(stage_.similarity(i, j)));
      if (k < 2) continue;
      const double before = stage_.motion(i) - stage_.motion(sent.frames[k - 2]);
      largest(stats.jump, std::abs(motion - before));
    }
    stats.mean_quality /= std::max(1.0, count);
    for (std::size_t k = 0; k < sent.frames.size(); ++k) {
      const std::int64_t begin_ns = sent.begin_ns[k];
      if (begin_ns < outage_.link.outage_end_ns || begin_ns > carried_until_ns) continue;
      const std::size_t bytes = stage_.bytes_at(sent.frames[k], sent.quality[k]);
      const auto passed = static_cast<double>(carried_until_ns - begin_ns) /
                          static_cast<double>(finish_(begin_ns, bytes) - begin_ns);
      stats.bytes += std::min(1.0, passed) * static_cast<double>(bytes);
    }
    return stats;
  }

  /// With what an oracle does after the same last frame before the return.
  void compare(OutageStats& stats, const Sent& own, bool may_reduce) {
    const double lateness_s = std::max(stats.live_again_s, asked_s_);
    if (const auto best = by_time(lateness_s, may_reduce, own)) {
      const double oracle_s = std::max(best->path.largest_cost, longest_interval_s(*best, stats));
      stats.vs_oracle = oracle_s / stats.largest_step_s;
      stats.vs_oracle_quality = std::min(1.0, stats.least_quality / best->quality);
    }
    if (const auto best = by_motion(lateness_s, own)) {
      stats.vs_oracle_motion =
          stats.largest_motion > 0 ? best->largest_cost / stats.largest_motion : 1;
    }
    if (const auto best = by_similarity(lateness_s, own)) {
      stats.vs_oracle_similarity =
          best->largest_cost < 0 ? stats.smallest_similarity / -best->largest_cost : 1;
    }
  }

  std::optional<QualityPath> by_time(double lateness_s, bool may_reduce, const Sent& own) {
    const auto qualities = oracle_qualities();
    const StepCost cost = [this](std::size_t i, std::size_t j) {
      return stage_.time_s(j) - stage_.time_s(i);
    };
    return oracle(problem(lateness_s, own), bytes_at(),
                  qualities.first(may_reduce ? qualities.size() : 1), cost, true, kSameTimeS);
  }
  std::optional<OraclePath> by_motion(double lateness_s, const Sent& own) {
    const StepCost cost = [this](std::size_t i, std::size_t j) {
      return stage_.motion(j) - stage_.motion(i);
    };
    return oracle(problem(lateness_s, own), cost, true, kSameMotion);
  }
  std::optional<OraclePath> by_similarity(double lateness_s, const Sent& own) {
    const StepCost cost = [this](std::size_t i, std::size_t j) {
      return -static_cast<double>(stage_.similarity(i, j));
    };
    return oracle(problem(lateness_s, own), cost, false, 0.5);
  }

  /// What could have been sent with the opportunities of this run of a FIFO, going by M.
  Sent by_fifo(const Delivery& delivery) {
    const std::size_t first = frames_.front()->sequence;
    Delivery best = delivery;
    best.received = fifo_oracle(delivery, [&](std::size_t i, std::size_t j) {
      return stage_.similarity(first + i, first + j);
    });
    for (std::size_t& frame : best.received) frame += first;
    return sent(best);
  }

  /// What drop-oldest has sent.
  const Sent& reference() const { return reference_; }
  double asked_s() const { return asked_s_; }

 private:
  /// Simulates this long after the outage only.
  void cut(double tail_s) {
    const auto at = [this](double time_s) {
      return std::ranges::lower_bound(stage_.frames(), to_ns(time_s), {},
                                      [](const FramePtr& frame) { return frame->capture_time_ns; });
    };
    frames_.assign(at(to_s(outage_.link.outage_begin_ns) - kLeadS),
                   at(to_s(outage_.link.outage_end_ns) + tail_s));
  }

  std::int64_t judged_until_ns(const OutageStats& stats) const {
    return outage_.link.outage_end_ns +
           to_ns(std::max(stats.live_again_s, asked_s_) + kJudgedAfterS);
  }

  /// Between two frames that are captured one after the other, behind the path's end: no policy has
  /// shorter steps there.
  double longest_interval_s(const QualityPath& best, const OutageStats& stats) const {
    double longest_s = 0;
    for (std::size_t i = best.path.frames.back(); i + 1 < stage_.frames().size(); ++i) {
      if (stage_.frames()[i + 1]->capture_time_ns > judged_until_ns(stats)) break;
      longest_s = std::max(longest_s, stage_.time_s(i + 1) - stage_.time_s(i));
    }
    return longest_s;
  }

  std::optional<double> live_again_s(const Sent& sent) const {
    return sim::live_again_s(stage_.frames(), sent.frames, sent.begin_ns,
                             outage_.link.outage_end_ns);
  }

  Sent before_return(Sent sent) const {
    const auto first = std::ranges::lower_bound(sent.begin_ns, outage_.link.outage_end_ns);
    const auto count = static_cast<std::size_t>(first - sent.begin_ns.begin());
    sent.frames.resize(count);
    sent.begin_ns.resize(count);
    sent.quality.resize(count);
    return sent;
  }

  OracleProblem problem(double lateness_s, const Sent& own) const {
    const Sent before = before_return(own);
    OracleProblem problem{stage_.frames(), finish_};
    problem.last = before.frames.back();
    problem.last_begin_ns = before.begin_ns.back();
    problem.last_bytes = stage_.bytes_at(problem.last, before.quality.back());
    problem.deadline_ns = outage_.link.outage_end_ns + to_ns(lateness_s);
    return problem;
  }

  Stage& stage_;
  const Outage& outage_;
  const FinishTime finish_;
  std::vector<FramePtr> frames_;
  Sent reference_;  // drop-oldest
  double asked_s_ = kLongestTailS;
};

}  // namespace

std::vector<Contender> contenders() {
  std::vector<Contender> all;
  for (const std::string_view name : kPolicies) {
    all.push_back({std::string(name),
                   [name](const Setup& setup) { return make_shipped(name, setup); },
                   name == "catch-up"});
  }
  all.push_back({"catch-up-full", [](const Setup& setup) { return make_full(setup); }});
  for (const int quality : {50, 30, 20}) all.push_back(fixed(quality));
  all.push_back({"catch-up-steered", make_steered});
  all.push_back({"afr", make_afr});
  return all;
}

Contender contender(std::string_view name) {
  for (Contender& candidate : contenders()) {
    if (candidate.name == name) return candidate;
  }
  throw std::invalid_argument("no policy " + std::string(name));
}

std::span<const int> oracle_qualities() {
  static const std::vector<int> kFalling = [] {
    std::vector<int> falling;
    for (int quality = kQuality; quality >= kLeastQuality; --quality) falling.push_back(quality);
    return falling;
  }();
  return kFalling;
}

std::vector<Outage> draw_outages(const RecordedSequence& sequence,
                                 const std::vector<double>& buffers_s,
                                 const std::vector<double>& rates, std::size_t count_of_each,
                                 std::uint64_t seed) {
  constexpr double kLongestS = 4;
  constexpr double kShortestS = 0.5;
  constexpr double kMarginS = 0.4;  // before and after the outage
  std::mt19937_64 random(seed);
  std::vector<Outage> outages;
  const double interval_s = sequence.mean_interval_ns() * 1e-9;
  const double length_s = interval_s * static_cast<double>(sequence.size() - 1);
  for (const double buffer_s : buffers_s) {
    for (const double rate : rates) {
      for (std::size_t i = 0; i < count_of_each; ++i) {
        const double duration_s = uniform(random, kShortestS, kLongestS);
        const double begin_s = uniform(random, kMarginS, length_s - duration_s - kMarginS);
        Outage& outage = outages.emplace_back();
        outage.buffer_s = buffer_s;
        outage.rate = rate;
        outage.capacity =
            static_cast<std::size_t>(std::max(3L, std::lround(buffer_s / interval_s)));
        outage.link = {rate * sequence.mean_jpeg_bytes() / interval_s, to_ns(begin_s),
                       to_ns(begin_s + duration_s)};
        outage.seed = random();
      }
    }
  }
  return outages;
}

std::vector<Column> run(Stage& stage, const std::vector<Outage>& outages) {
  struct Entry {
    Contender contender;
    const std::vector<FramePtr>* stand_ins;
  };
  std::vector<Entry> entries;
  for (Contender& contender : contenders()) {
    if (contender.name == "catch-up") {
      entries.push_back({{"catch-up-motion", contender.make, true}, &stage.by_motion()});
      entries.push_back({{"catch-up-both", contender.make, true}, &stage.by_both()});
    }
    entries.push_back({std::move(contender), nullptr});
  }
  std::vector<Column> columns;
  for (const Entry& entry : entries) columns.push_back({entry.contender.name, {}});
  for (const char* name : {"oracle", "oracle-time", "oracle-motion", "oracle-m", "oracle-fifo"}) {
    columns.push_back({name, {}});
  }
  for (const Outage& outage : outages) {
    Run run(stage, outage);
    std::size_t column = 0;
    std::optional<OutageStats> by_fifo;
    for (const auto& [contender, stand_ins] : entries) {
      const Delivery delivery = run.simulate(contender, stand_ins);
      const Sent sent = run.sent(delivery);
      OutageStats stats = run.measure(sent);
      run.compare(stats, sent, contender.may_reduce);
      if (contender.name == "orbbuf") {
        by_fifo = run.measure(run.by_fifo(delivery));
        stats.vs_fifo_oracle = by_fifo->smallest_similarity > 0
                                   ? stats.smallest_similarity / by_fifo->smallest_similarity
                                   : 1;
      }
      columns[column++].runs.push_back(stats);
    }
    const double lateness_s = run.asked_s();
    for (const bool may_reduce : {true, false}) {
      const auto best = run.by_time(lateness_s, may_reduce, run.reference());
      OutageStats stats = best ? run.measure(run.sent(best->path, best->quality)) : OutageStats{};
      columns[column++].runs.push_back(stats);
    }
    for (const auto& path : {run.by_motion(lateness_s, run.reference()),
                             run.by_similarity(lateness_s, run.reference())}) {
      OutageStats stats = path ? run.measure(run.sent(*path)) : OutageStats{};
      columns[column++].runs.push_back(stats);
    }
    columns[column].runs.push_back(*by_fifo);
  }
  return columns;
}

}  // namespace orbbuf::sim
