// SPDX-License-Identifier: Apache-2.0
// The links of moving cars: how wrong the path is, as a multiple of the unbroken sequence's.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <tuple>
#include <utility>

#include "bench/sim/fifo_oracle.hpp"
#include "bench/sim/mobile_link.hpp"
#include "bench/sim/trial.hpp"
#include "common/progress.hpp"
#include "daemon/buffer/make_policy.hpp"
#include "daemon/image/orb_extractor.hpp"
#include "evaluation/random.hpp"
#include "evaluation/trial/experiments.hpp"
#include "evaluation/trial/report.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kGoodRatio = 1.2;
constexpr double kLost = std::numeric_limits<double>::infinity();
const char* const kClairvoyant = "clairvoyant";  // as far as M goes
const char* const kByMotion = "by-motion";       // knows the true path
constexpr double kMuchMotionM = 3;  // between neighbours; a turn of 10 degrees counts as a metre

struct Run {
  std::string trace;
  double need = 0;  ///< of the stream, as a multiple of the link's mean
  std::size_t repeat = 0;
  std::size_t capacity = 0;
  std::string policy;
  std::vector<std::size_t> received;
  double ratio = kLost;  ///< of the ATE to the unbroken sequence's
};

std::vector<sim::RateTrace> load_traces(const TrialOptions& options) {
  std::vector<sim::RateTrace> traces;
  for (const auto& file : options.traces) {
    if (!exists(file)) {
      fmt::print("skipped: no {}\n", file.string());
      continue;
    }
    traces.push_back(sim::read_trace(file));
  }
  return traces;
}

bool is_scaled(const sim::RateTrace& trace) { return trace.name.starts_with("report_"); }

/// Falls with the square of the motion, so that the best sequence has even steps.
int steadiness(double motion_m) {
  const double much = motion_m / kMuchMotionM;
  return static_cast<int>(1e9 * std::exp(-std::min(20.0, much * much)));
}

/// Where in a trace a run begins.
struct Start {
  const sim::RateTrace* trace = nullptr;
  double need = 0;
  std::size_t repeat = 0;
  double offset_s = 0;
  std::uint64_t seed = 0;

  double scale(double stream_bytes_per_s) const {
    return is_scaled(*trace) ? stream_bytes_per_s / need / trace->mean_bytes_per_s() : 1;
  }
};

std::vector<Start> draw_starts(const std::vector<sim::RateTrace>& traces,
                               const TrialOptions& options) {
  std::mt19937_64 random(options.seed);
  std::vector<Start> starts;
  for (const sim::RateTrace& trace : traces) {
    for (const double need : is_scaled(trace) ? options.needs : std::vector<double>{0}) {
      for (std::size_t i = 0; i < options.repeats; ++i) {
        const double offset_s = uniform(random, 0, trace.duration_s());
        starts.push_back({&trace, need, i, offset_s, random()});
      }
    }
  }
  return starts;
}

sim::FinishTime link_from(const Start& start, double stream_bytes_per_s) {
  return [&trace = *start.trace, scale = start.scale(stream_bytes_per_s), at_s = start.offset_s](
             std::int64_t start_ns, std::size_t bytes) {
    return sim::finish(trace, scale, at_s, start_ns, bytes);
  };
}

/// The policies, and with the first size of buffer two clairvoyants with the default's
/// opportunities.
void simulate_start(Scene& scene, const Start& start, const TrialOptions& options,
                    std::size_t capacity, std::vector<Run>& runs) {
  sim::RecordedSequence& sequence = scene.sequence();
  const double stream = sequence.mean_jpeg_bytes() * scene.fps();
  const sim::FinishTime link = link_from(start, stream);
  Run run{start.trace->name,
          stream / (start.trace->mean_bytes_per_s() * start.scale(stream)),
          start.repeat,
          capacity,
          "",
          {},
          kLost};
  const auto add = [&](const std::string& policy, std::vector<std::size_t> received) {
    run.policy = policy;
    run.received = std::move(received);
    runs.push_back(run);
  };
  sim::Setup setup;
  setup.capacity = capacity;
  setup.seed = start.seed;
  setup.similarity = [&](std::size_t i, std::size_t j) { return sequence.similarity(i, j); };
  for (const sim::Contender& contender : sim::contenders()) {
    if (std::ranges::count(options.policies, contender.name) == 0) continue;
    const auto delivery = sim::simulate(sequence.frames(), link, contender.make(setup));
    add(contender.name, delivery.received);
    if (contender.name != "orbbuf" || capacity != options.buffers.front()) continue;
    add(kClairvoyant, sim::fifo_oracle(delivery, [&](std::size_t i, std::size_t j) {
          return sequence.similarity(i, j);
        }));
    add(kByMotion, sim::fifo_oracle(delivery, [&](std::size_t i, std::size_t j) {
          return steadiness(scene.motion_m(i, j));
        }));
  }
}

/// The default policy with its own features, and what its choices take, by the newest frame.
class TimedPolicy final : public DropPolicy {
 public:
  explicit TimedPolicy(std::vector<double>& times_ms)
      : times_ms_(times_ms), policy_(make_policy({}, [this](const auto& frame, auto& features) {
          extractor_.extract(frame, features);
        })) {}

  bool prepare(const BufferView& view) override { return policy_->prepare(view); }
  std::size_t victim(const BufferView& view) override {
    const auto begin = std::chrono::steady_clock::now();
    const std::size_t victim = policy_->victim(view);
    times_ms_.at(view.waiting.back()->sequence) +=
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    return victim;
  }

 private:
  std::vector<double>& times_ms_;
  OrbExtractor extractor_{FeatureSettings{}};
  std::unique_ptr<DropPolicy> policy_;
};

/// Of an even number the larger of the two in the middle, which is lost if either is.
double median(std::vector<double> values) {
  if (values.empty()) return kLost;
  std::ranges::sort(values);
  return values[values.size() / 2];
}

std::vector<double> ratios(const std::vector<Run>& runs, const std::string& trace,
                           std::string_view policy) {
  std::vector<double> values;
  for (const Run& run : runs) {
    if (run.policy == policy && (trace.empty() || run.trace == trace)) values.push_back(run.ratio);
  }
  return values;
}

/// Of the starts from which the ratio of `other`, or of anybody if that is empty, is good, those in
/// which this policy's is: where one could do it, it could be done.
Share good_where_possible(const std::vector<Run>& runs, std::string_view policy,
                          std::string_view other) {
  std::map<std::tuple<std::string, double, std::size_t>, std::pair<bool, bool>> starts;
  for (const Run& run : runs) {
    auto& [is_possible, is_good] = starts[{run.trace, run.need, run.repeat}];
    if (run.ratio > kGoodRatio) continue;
    is_possible = is_possible || other.empty() || run.policy == other;
    if (run.policy == policy) is_good = true;
  }
  Share share;
  for (const auto& [start, done] : starts) {
    share.all += done.first ? 1 : 0;
    share.some += done.first && done.second ? 1 : 0;
  }
  return share;
}

/// How many times as wrong as the default's path drop-oldest's is.
double times_better(const std::vector<Run>& runs, const std::string& trace) {
  return median(ratios(runs, trace, "drop-oldest")) / median(ratios(runs, trace, "orbbuf"));
}

std::string times(double better) {
  if (std::isnan(better)) return "both lost";
  if (better == 0) return "orbbuf lost";
  return better == kLost ? "drop-oldest lost" : fmt::format("{:.2f}", better);
}

void write_csv(const std::vector<Run>& runs, const TrialOptions& options) {
  std::string csv = "trace,need,repeat,buffer,policy,delivered,ate_ratio\n";
  for (const Run& run : runs) {
    csv += fmt::format("{},{:.3f},{},{},{},{},{:.4f}\n", run.trace, run.need, run.repeat,
                       run.capacity, run.policy, run.received.size(), run.ratio);
  }
  write_text(options.out / "traces.csv", csv);
}

std::string report(const std::vector<Run>& runs, const std::vector<sim::RateTrace>& traces,
                   const TrialOptions& options) {
  std::string markdown = "| policy |";
  std::string line = "\n|---|";
  std::string better = "| drop-oldest / orbbuf |";
  std::string results;
  for (const sim::RateTrace& trace : traces) {
    markdown += fmt::format(" {} |", trace.name);
    line += "---|";
    const double ratio = times_better(runs, trace.name);
    better += fmt::format(" {} |", times(ratio));
    if (std::isnan(ratio)) continue;  // both are lost
    results += fmt::format("RESULT paper.4g.{}.drop_oldest_by_orbbuf {:.3f}\n", trace.name, ratio);
  }
  markdown += " lost | at most 1.2, where anybody is | where the clairvoyant is |" + line;
  markdown += "---|---|---|\n";
  std::vector<std::string> policies = options.policies;
  policies.insert(policies.end(), {kClairvoyant, kByMotion});
  for (const std::string& policy : policies) {
    markdown += fmt::format("| {} |", policy);
    for (const sim::RateTrace& trace : traces) {
      const double ratio = median(ratios(runs, trace.name, policy));
      markdown += fmt::format(" {} |", ratio_text(ratio));
      results += fmt::format("RESULT paper.4g.{}.{}.ate_ratio {:.3f}\n", trace.name, policy, ratio);
    }
    const auto all = ratios(runs, "", policy);
    const Share good = good_where_possible(runs, policy, "");
    const Share with_clairvoyant = good_where_possible(runs, policy, kClairvoyant);
    markdown +=
        fmt::format(" {} of {} | {} of {}: {} | {} of {}: {} |\n", std::ranges::count(all, kLost),
                    all.size(), good.some, good.all, to_text(good), with_clairvoyant.some,
                    with_clairvoyant.all, to_text(with_clairvoyant));
    results += fmt::format(
        "RESULT paper.4g.{0}.good_share {1:.4f}\n"
        "RESULT paper.4g.{0}.good_share_where_clairvoyant {2:.4f}\n",
        policy, good.value(), with_clairvoyant.value());
  }
  write_text(options.out / "traces.md", markdown + better + " | | |\n");
  return results;
}

}  // namespace

std::string try_traces(Scene& scene, const TrialOptions& options) {
  const std::vector<sim::RateTrace> traces = load_traces(options);
  if (traces.empty()) return "";
  std::vector<Run> runs;
  {
    const std::vector<Start> starts = draw_starts(traces, options);
    Progress progress("simulate traces", "starts", starts.size());
    for (const Start& start : starts) {
      for (const std::size_t capacity : options.buffers) {
        simulate_start(scene, start, options, capacity, runs);
      }
      progress.add();
    }
  }
  for_each_parallel("traces", runs.size(),
                    [&](std::size_t i) { runs[i].ratio = scene.ate_ratio(runs[i].received); });
  write_csv(runs, options);
  std::erase_if(runs, [&](const Run& run) { return run.capacity != options.buffers.front(); });
  return report(runs, traces, options);
}

std::string time_enqueue(Scene& scene, const TrialOptions& options) {
  const std::vector<sim::RateTrace> traces = load_traces(options);
  if (traces.empty()) return "";
  const sim::RecordedSequence& sequence = scene.sequence();
  std::vector<double> times_ms(scene.size(), 0);
  sim::simulate(
      sequence.frames(),
      link_from(draw_starts(traces, options).front(), sequence.mean_jpeg_bytes() * scene.fps()),
      {{.frames = options.buffers.front()}, std::make_unique<TimedPolicy>(times_ms)});
  std::string csv = "frame,ms\n";
  for (std::size_t i = 0; i < times_ms.size(); ++i)
    csv += fmt::format("{},{:.4f}\n", i, times_ms[i]);
  write_text(options.out / "enqueue.csv", csv);
  std::erase(times_ms, 0);
  if (times_ms.empty()) return "";
  return fmt::format(
      "RESULT paper.enqueue.median_ms {:.3f}\nRESULT paper.enqueue.worst_ms {:.3f}\n",
      median(times_ms), *std::ranges::max_element(times_ms));
}

}  // namespace orbbuf::evaluation
