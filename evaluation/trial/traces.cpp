// SPDX-License-Identifier: Apache-2.0
// The links of moving cars: how wrong the path is, as a multiple of the unbroken sequence's.
#include <fmt/core.h>

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
const char* const kOracle = "oracle-fifo";           // keeps the largest M between neighbours
const char* const kPathOracle = "oracle-fifo-path";  // keeps the smallest true motion
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

/// The policies, and with the first size of buffer two oracles, which may send when orbbuf did.
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
    add(kOracle, sim::fifo_oracle(delivery, [&](std::size_t i, std::size_t j) {
          return sequence.similarity(i, j);
        }));
    add(kPathOracle, sim::fifo_oracle(delivery, [&](std::size_t i, std::size_t j) {
          return steadiness(scene.motion_m(i, j));
        }));
  }
}

BufferSettings orbbuf_settings() {
  BufferSettings settings;
  settings.policy = "orbbuf";
  return settings;
}

/// `orbbuf` with its own features, and what its choices take, by the newest frame. Under catch-up
/// nothing is chosen when a frame is added.
class TimedPolicy final : public DropPolicy {
 public:
  explicit TimedPolicy(std::vector<double>& times_ms)
      : times_ms_(times_ms),
        policy_(make_policy(orbbuf_settings(), [this](const auto& frame, auto& features) {
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

/// Of the starts from which the ratio of `other`, or of any policy if that is empty, is good, those
/// in which this policy's is.
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

/// How many times as wrong as this policy's path drop-oldest's is.
double times_better(const std::vector<Run>& runs, const std::string& trace,
                    const std::string& policy) {
  return median(ratios(runs, trace, "drop-oldest")) / median(ratios(runs, trace, policy));
}

/// The same from each start; 1 if both are lost.
std::vector<double> times_better_by_start(const std::vector<Run>& runs, const std::string& policy) {
  std::map<std::tuple<std::string, double, std::size_t>, std::pair<double, double>> starts;
  for (const Run& run : runs) {
    auto& [other, own] = starts[{run.trace, run.need, run.repeat}];
    if (run.policy == "drop-oldest") other = run.ratio;
    if (run.policy == policy) own = run.ratio;
  }
  std::vector<double> values;
  for (const auto& [start, pair] : starts) {
    const double value = pair.first / pair.second;
    values.push_back(std::isnan(value) ? 1 : value);
  }
  return values;
}

std::string times(double better, const std::string& policy) {
  if (std::isnan(better)) return "both lost";
  if (better == 0) return policy + " lost";
  return better == kLost ? "drop-oldest lost" : fmt::format("{:.2f}", better);
}

/// The table's row of these ratios, and RESULT lines.
std::pair<std::string, std::string> report_times_better(const std::vector<Run>& runs,
                                                        const std::vector<sim::RateTrace>& traces,
                                                        const std::string& policy) {
  std::string row = fmt::format("| drop-oldest / {} |", policy);
  std::string results;
  for (const sim::RateTrace& trace : traces) {
    const double ratio = times_better(runs, trace.name, policy);
    row += fmt::format(" {} |", times(ratio, policy));
    if (std::isnan(ratio)) continue;  // both are lost
    results +=
        fmt::format("RESULT paper.4g.{}.drop_oldest_by_{} {:.3f}\n", trace.name, policy, ratio);
  }
  const Median all = median_of(times_better_by_start(runs, policy));
  row += fmt::format(" by start: {:.2f} ({:.2f} to {:.2f}) | | |\n", all.middle, all.low, all.high);
  results += fmt::format(
      "RESULT paper.4g.drop_oldest_by_{0}.median {1:.3f}\n"
      "RESULT paper.4g.drop_oldest_by_{0}.low {2:.3f}\n"
      "RESULT paper.4g.drop_oldest_by_{0}.high {3:.3f}\n",
      policy, all.middle, all.low, all.high);
  return {row, results};
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
  std::string results;
  for (const sim::RateTrace& trace : traces) {
    markdown += fmt::format(" {} |", trace.name);
    line += "---|";
  }
  markdown += " lost | at most 1.2, where any policy is | where oracle-fifo is |" + line;
  markdown += "---|---|---|\n";
  const auto has = [&](const char* policy) {
    return std::ranges::count(options.policies, policy) > 0;
  };
  std::vector<std::string> policies = options.policies;
  policies.insert(policies.end(), {kOracle, kPathOracle});
  for (const std::string& policy : policies) {
    markdown += fmt::format("| {} |", policy);
    for (const sim::RateTrace& trace : traces) {
      const double ratio = median(ratios(runs, trace.name, policy));
      markdown += fmt::format(" {} |", ratio_text(ratio));
      results += fmt::format("RESULT paper.4g.{}.{}.ate_ratio {:.3f}\n", trace.name, policy, ratio);
    }
    const auto all = ratios(runs, "", policy);
    const Share good = good_where_possible(runs, policy, "");
    const Share with_oracle = good_where_possible(runs, policy, kOracle);
    markdown += fmt::format(" {} of {} | {} of {}: {} | {} of {}: {} |\n",
                            std::ranges::count(all, kLost), all.size(), good.some, good.all,
                            to_text(good), with_oracle.some, with_oracle.all, to_text(with_oracle));
    results += fmt::format(
        "RESULT paper.4g.{0}.good_share {1:.4f}\n"
        "RESULT paper.4g.{0}.good_share_where_oracle {2:.4f}\n",
        policy, good.value(), with_oracle.value());
  }
  for (const char* policy : {"catch-up", "orbbuf"}) {
    if (!has("drop-oldest") || !has(policy)) continue;
    const auto [row, lines] = report_times_better(runs, traces, policy);
    markdown += row;
    results += lines;
  }
  write_text(options.out / "traces.md", markdown);
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
