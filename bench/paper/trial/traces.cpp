// SPDX-License-Identifier: Apache-2.0
// The links of moving cars: how wrong the path is, as a multiple of the unbroken sequence's.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <tuple>
#include <utility>

#include "bench/paper/progress.hpp"
#include "bench/paper/random.hpp"
#include "bench/paper/trial/experiments.hpp"
#include "bench/paper/trial/mobile_link.hpp"
#include "bench/paper/trial/report.hpp"
#include "bench/sim/clairvoyant.hpp"
#include "bench/sim/trial.hpp"
#include "daemon/buffer/make_policy.hpp"

namespace orbbuf::paper {
namespace {

constexpr double kBufferS = 2;
constexpr double kGoodRatio = 1.2;
constexpr double kLost = std::numeric_limits<double>::infinity();
const char* const kClairvoyant = "clairvoyant";  // as far as M goes
const char* const kByMotion = "by-motion";       // knows the true path
constexpr double kMuchMotionM = 3;  // between neighbours; a turn of 10 degrees counts as a metre

struct Run {
  std::string trace;
  double need = 0;  ///< of the stream, as a multiple of the link's mean
  std::size_t repeat = 0;
  std::string policy;
  std::vector<std::size_t> received;
  double ratio = kLost;  ///< of the ATE to the unbroken sequence's
};

std::vector<RateTrace> load_traces(const TrialOptions& options) {
  std::vector<RateTrace> traces;
  for (const char* name :
       {"ghent/report_car_0001.json", "ghent/report_car_0002.json", "ghent/report_car_0003.json",
        "ghent/report_car_0004.json", "mahimahi/ATT-LTE-driving-2016.up",
        "mahimahi/TMobile-LTE-short.up", "mahimahi/Verizon-LTE-short.up"}) {
    if (!exists(options.traces / name)) {
      fmt::print("skipped: no {}\n", (options.traces / name).string());
      continue;
    }
    traces.push_back(read_trace(options.traces / name));
  }
  return traces;
}

bool is_scaled(const RateTrace& trace) { return trace.name.starts_with("report_"); }

/// Falls with the square of the motion, so that the best sequence has even steps.
int steadiness(double motion_m) {
  const double much = motion_m / kMuchMotionM;
  return static_cast<int>(1e9 * std::exp(-std::min(20.0, much * much)));
}

/// All policies, and two clairvoyants with the default's opportunities, from one start in a trace.
void simulate_start(Scene& scene, const RateTrace& trace, double need, std::size_t repeat,
                    std::mt19937_64& random, std::vector<Run>& runs) {
  sim::RecordedSequence& sequence = scene.sequence();
  const double stream = sequence.mean_jpeg_bytes() * scene.fps();
  const double scale = is_scaled(trace) ? stream / need / trace.mean_bytes_per_s() : 1;
  const double offset_s = uniform(random, 0, trace.duration_s());
  const std::uint64_t seed = random();
  const auto capacity = static_cast<std::size_t>(std::lround(kBufferS * scene.fps()));
  const sim::FinishTime link = [&](std::int64_t start_ns, std::size_t bytes) {
    return finish(trace, scale, offset_s, start_ns, bytes);
  };
  const double real_need = stream / (trace.mean_bytes_per_s() * scale);
  for (const sim::Contender& contender : sim::contenders()) {
    if (contender.name.starts_with("idea-")) continue;
    const auto delivery =
        sim::simulate(sequence.frames(), link, capacity, contender.make(sequence, seed));
    runs.push_back({trace.name, real_need, repeat, contender.name, delivery.received, kLost});
    if (contender.name != "orbbuf") continue;
    const auto best = sim::clairvoyant(
        delivery, [&](std::size_t i, std::size_t j) { return sequence.similarity(i, j); });
    runs.push_back({trace.name, real_need, repeat, kClairvoyant, best, kLost});
    const auto steady = sim::clairvoyant(
        delivery, [&](std::size_t i, std::size_t j) { return steadiness(scene.motion_m(i, j)); });
    runs.push_back({trace.name, real_need, repeat, kByMotion, steady, kLost});
  }
}

double median(std::vector<double> values) {
  if (values.empty()) return kLost;
  std::ranges::sort(values);
  return values[(values.size() - 1) / 2];
}

std::vector<double> ratios(const std::vector<Run>& runs, const std::string& trace,
                           std::string_view policy) {
  std::vector<double> values;
  for (const Run& run : runs) {
    if (run.policy == policy && (trace.empty() || run.trace == trace)) values.push_back(run.ratio);
  }
  return values;
}

/// Of the starts from which anybody's ratio is good, clairvoyants' included, those in which this
/// policy's is: where one could do it, it could be done.
Share good_where_possible(const std::vector<Run>& runs, std::string_view policy) {
  std::map<std::tuple<std::string, double, std::size_t>, std::pair<bool, bool>> starts;
  for (const Run& run : runs) {
    auto& [is_possible, is_good] = starts[{run.trace, run.need, run.repeat}];
    if (run.ratio > kGoodRatio) continue;
    is_possible = true;
    if (run.policy == policy) is_good = true;
  }
  Share share;
  for (const auto& [start, done] : starts) {
    share.all += done.first ? 1 : 0;
    share.some += done.second ? 1 : 0;
  }
  return share;
}

std::string number(double ratio) { return ratio == kLost ? "lost" : fmt::format("{:.2f}", ratio); }

std::string report(const std::vector<Run>& runs, const std::vector<RateTrace>& traces,
                   const TrialOptions& options) {
  std::string csv = "trace,need,repeat,policy,delivered,ate_ratio\n";
  for (const Run& run : runs) {
    csv += fmt::format("{},{:.3f},{},{},{},{:.4f}\n", run.trace, run.need, run.repeat, run.policy,
                       run.received.size(), run.ratio);
  }
  write_text(options.out / "traces.csv", csv);
  std::vector<std::string> policies(kPolicies.begin(), kPolicies.end());
  policies.insert(policies.end(), {kClairvoyant, kByMotion});
  std::string markdown = "| policy |";
  std::string line = "\n|---|";
  for (const RateTrace& trace : traces) {
    markdown += fmt::format(" {} |", trace.name);
    line += "---|";
  }
  markdown += " lost | at most 1.2, where anybody is |" + line + "---|---|\n";
  std::string results;
  for (const std::string& policy : policies) {
    markdown += fmt::format("| {} |", policy);
    for (const RateTrace& trace : traces) {
      const double ratio = median(ratios(runs, trace.name, policy));
      markdown += fmt::format(" {} |", number(ratio));
      results += fmt::format("RESULT paper.4g.{}.{}.ate_ratio {:.3f}\n", trace.name, policy, ratio);
    }
    const auto all = ratios(runs, "", policy);
    markdown += fmt::format(" {} of {} | {} |\n", std::ranges::count(all, kLost), all.size(),
                            to_text(good_where_possible(runs, policy)));
    results += fmt::format("RESULT paper.4g.{}.good_share {:.4f}\n", policy,
                           good_where_possible(runs, policy).value());
  }
  write_text(options.out / "traces.md", markdown);
  return results;
}

}  // namespace

std::string try_traces(Scene& scene, const TrialOptions& options) {
  const std::vector<RateTrace> traces = load_traces(options);
  if (traces.empty()) return "";
  std::mt19937_64 random(options.seed);
  std::vector<Run> runs;
  {
    Progress progress("simulate traces", "traces", traces.size());
    for (const RateTrace& trace : traces) {
      for (const double need : is_scaled(trace) ? options.needs : std::vector<double>{0}) {
        for (std::size_t i = 0; i < options.repeats; ++i) {
          simulate_start(scene, trace, need, i, random, runs);
        }
      }
      progress.add();
    }
  }
  const Stretch all{0, scene.size()};
  const double unbroken_m = scene.error(scene.unbroken().trajectory, all).ate_m;
  for_each_parallel("traces", runs.size(), [&](std::size_t i) {
    const Verdict verdict = scene.judge(runs[i].received, scene.size());
    if (!verdict.is_lost()) {
      runs[i].ratio = scene.error(verdict.trajectory, all).ate_m / unbroken_m;
    }
  });
  return report(runs, traces, options);
}

}  // namespace orbbuf::paper
