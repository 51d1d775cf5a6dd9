// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/trial.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <random>
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
constexpr double kLongestTailS = 20;   // simulated after the outage
constexpr auto kUnbounded = std::chrono::seconds(1000);
constexpr double kSameTimeS = 1e-6;
constexpr double kSameMotion = 1e-6;

/// The same draw on every platform, which std::uniform_real_distribution does not promise.
double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

std::int64_t to_ns(double seconds) { return std::llround(seconds * 1e9); }
double to_s(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

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

SimulatedBuffer make_shipped(std::string_view name, const Setup& setup) {
  if (name == "orbbuf") return {{.frames = setup.capacity}, make_orbbuf(setup.similarity)};
  if (name == "catch-up") {
    SimulatedBuffer buffer{{}, std::make_unique<UniformPolicy>()};
    buffer.planner =
        std::make_unique<SendPlanner>(PlanSettings{setup.live_again, setup.largest_step});
    buffer.stand_ins = setup.stand_ins;
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
    cut(asked_s_ + 2);
  }

  Delivery simulate(const Contender& contender, const std::vector<FramePtr>* stand_ins = nullptr) {
    Setup setup;
    setup.capacity = outage_.capacity;
    setup.live_again = std::chrono::nanoseconds(to_ns(asked_s_));
    setup.largest_step = kUnbounded;
    setup.seed = outage_.seed;
    setup.similarity = similarity();
    setup.stand_ins = stand_ins;
    return sim::simulate(frames_, finish_, contender.make(setup));
  }

  PairSimilarity similarity() {
    return [this](std::size_t i, std::size_t j) { return stage_.similarity(i, j); };
  }

  /// From the two last sends before the link's return.
  Sent sent(const Delivery& delivery) const {
    const auto first = std::ranges::lower_bound(delivery.begin_ns, outage_.link.outage_end_ns) -
                       delivery.begin_ns.begin();
    const auto from = std::max<std::ptrdiff_t>(0, first - 2);
    return {{delivery.received.begin() + from, delivery.received.end()},
            {delivery.begin_ns.begin() + from, delivery.begin_ns.end()}};
  }

  Sent sent(const OraclePath& path) const {
    Sent all = before_return();
    all.frames.insert(all.frames.end(), path.frames.begin(), path.frames.end());
    all.begin_ns.insert(all.begin_ns.end(), path.begin_ns.begin(), path.begin_ns.end());
    return all;
  }

  OutageStats measure(const Sent& sent) {
    OutageStats stats;
    stats.smallest_similarity = std::numeric_limits<double>::max();
    stats.live_again_s = live_again_s(sent).value_or(kLongestTailS);
    const std::int64_t end_ns =
        outage_.link.outage_end_ns + to_ns(std::max(stats.live_again_s, asked_s_) + kJudgedAfterS);
    for (std::size_t k = 1; k < sent.frames.size() && sent.begin_ns[k] <= end_ns; ++k) {
      if (sent.begin_ns[k] < outage_.link.outage_end_ns) continue;
      const std::size_t i = sent.frames[k - 1];
      const std::size_t j = sent.frames[k];
      const double motion = stage_.motion(j) - stage_.motion(i);
      const auto largest = [](double& value, double other) { value = std::max(value, other); };
      largest(stats.longest_gap, static_cast<double>(j - i - 1));
      largest(stats.largest_step_s, stage_.time_s(j) - stage_.time_s(i));
      largest(stats.largest_motion, motion);
      stats.smallest_similarity =
          std::min(stats.smallest_similarity, static_cast<double>(stage_.similarity(i, j)));
      if (k < 2) continue;
      const double before = stage_.motion(i) - stage_.motion(sent.frames[k - 2]);
      largest(stats.jump, std::abs(motion - before));
    }
    return stats;
  }

  void compare(OutageStats& stats) {
    const double lateness_s = std::max(stats.live_again_s, asked_s_);
    if (const auto best = by_time(lateness_s)) {
      stats.vs_oracle = best->largest_cost / stats.largest_step_s;
    }
    if (const auto best = by_motion(lateness_s)) {
      stats.vs_oracle_motion =
          stats.largest_motion > 0 ? best->largest_cost / stats.largest_motion : 1;
    }
    if (const auto best = by_similarity(lateness_s)) {
      stats.vs_oracle_similarity =
          best->largest_cost < 0 ? stats.smallest_similarity / -best->largest_cost : 1;
    }
  }

  std::optional<OraclePath> by_time(double lateness_s) {
    const StepCost cost = [this](std::size_t i, std::size_t j) {
      return stage_.time_s(j) - stage_.time_s(i);
    };
    return oracle(problem(lateness_s), cost, true, kSameTimeS);
  }
  std::optional<OraclePath> by_motion(double lateness_s) {
    const StepCost cost = [this](std::size_t i, std::size_t j) {
      return stage_.motion(j) - stage_.motion(i);
    };
    return oracle(problem(lateness_s), cost, true, kSameMotion);
  }
  std::optional<OraclePath> by_similarity(double lateness_s) {
    const StepCost cost = [this](std::size_t i, std::size_t j) {
      return -static_cast<double>(stage_.similarity(i, j));
    };
    return oracle(problem(lateness_s), cost, false, 0.5);
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

  /// With the first send that begins with the newest captured frame.
  std::optional<double> live_again_s(const Sent& sent) const {
    for (std::size_t k = 0; k < sent.frames.size(); ++k) {
      if (sent.begin_ns[k] < outage_.link.outage_end_ns) continue;
      const std::size_t next = sent.frames[k] + 1;
      if (next >= stage_.frames().size() ||
          stage_.frames()[next]->capture_time_ns >= sent.begin_ns[k]) {
        return to_s(sent.begin_ns[k] - outage_.link.outage_end_ns);
      }
    }
    return std::nullopt;
  }

  Sent before_return() const {
    Sent before;
    for (std::size_t k = 0; k < reference_.frames.size(); ++k) {
      if (reference_.begin_ns[k] >= outage_.link.outage_end_ns) break;
      before.frames.push_back(reference_.frames[k]);
      before.begin_ns.push_back(reference_.begin_ns[k]);
    }
    return before;
  }

  OracleProblem problem(double lateness_s) const {
    const Sent before = before_return();
    return {stage_.frames(), finish_, before.frames.back(), before.begin_ns.back(),
            outage_.link.outage_end_ns + to_ns(lateness_s)};
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
  all.reserve(kPolicies.size() + 1);
  for (const std::string_view name : kPolicies) {
    all.push_back(
        {std::string(name), [name](const Setup& setup) { return make_shipped(name, setup); }});
  }
  all.push_back({"afr", make_afr});
  return all;
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
      entries.push_back({{"catch-up-motion", contender.make}, &stage.by_motion()});
      entries.push_back({{"catch-up-both", contender.make}, &stage.by_both()});
    }
    entries.push_back({std::move(contender), nullptr});
  }
  std::vector<Column> columns;
  for (const Entry& entry : entries) columns.push_back({entry.contender.name, {}});
  for (const char* name : {"oracle-time", "oracle-motion", "oracle-m", "oracle-fifo"}) {
    columns.push_back({name, {}});
  }
  for (const Outage& outage : outages) {
    Run run(stage, outage);
    std::size_t column = 0;
    std::optional<OutageStats> by_fifo;
    for (const auto& [contender, stand_ins] : entries) {
      const Delivery delivery = run.simulate(contender, stand_ins);
      OutageStats stats = run.measure(run.sent(delivery));
      run.compare(stats);
      if (contender.name == "orbbuf") {
        by_fifo = run.measure(run.by_fifo(delivery));
        stats.vs_fifo_oracle = by_fifo->smallest_similarity > 0
                                   ? stats.smallest_similarity / by_fifo->smallest_similarity
                                   : 1;
      }
      columns[column++].runs.push_back(stats);
    }
    const double lateness_s = run.asked_s();
    for (const auto& path :
         {run.by_time(lateness_s), run.by_motion(lateness_s), run.by_similarity(lateness_s)}) {
      OutageStats stats = path ? run.measure(run.sent(*path)) : OutageStats{};
      columns[column++].runs.push_back(stats);
    }
    columns[column].runs.push_back(*by_fifo);
  }
  return columns;
}

}  // namespace orbbuf::sim
