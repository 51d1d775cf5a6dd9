// SPDX-License-Identifier: Apache-2.0
// orbbuf-sim: every policy over every sequence through many outages, on a virtual clock, against a
// clairvoyant; and what M says of frames. Prints tables, then RESULT lines.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <bit>
#include <exception>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "bench/sim/curves.hpp"
#include "bench/sim/trial.hpp"

namespace orbbuf::sim {
namespace {

constexpr std::size_t kNoisePairs = 1000;

struct Options {
  std::filesystem::path data;
  std::filesystem::path plots;
  std::size_t outages = 100;
  std::uint64_t seed = 1;
};

Sequences load(const Options& options) {
  Sequences sequences;
  for (const char* name : {"kitti05_stereo", "kitti06_mono", "picar_indoor"}) {
    SourceSettings source;
    source.kind = "folder";
    source.path = options.data / name / "images";
    if (!std::filesystem::exists(source.path)) {
      fmt::print("skipped: no {}\n", source.path.string());
      continue;
    }
    sequences.push_back(std::make_unique<RecordedSequence>(name, source));
  }
  SourceSettings generated;
  generated.frames = 375;  // 15 s, one turn and the beginning of the next cycle
  sequences.push_back(std::make_unique<RecordedSequence>("generated", generated));
  return sequences;
}

std::ofstream open(const Options& options, const std::string& name) {
  std::ofstream file(options.plots / name);
  if (!file) throw std::runtime_error("cannot write " + (options.plots / name).string());
  return file;
}

/// The `percent`-th percentile of values in rising order.
double percentile(const std::vector<double>& values, std::size_t percent) {
  return values[std::min(values.size() - 1, values.size() * percent / 100)];
}

void draw_distances(const Options& options, const Sequences& sequences) {
  fmt::print("\nM as a share of M(a, a): 5 %, median, 95 % of pairs by distance in frames\n");
  for (const auto& sequence : sequences) {
    fmt::print("  {:<15} M(a, a) {:3.0f}", sequence->name(), sequence->self_similarity());
    std::ofstream file = open(options, "distance_" + sequence->name() + ".dat");
    for (const DistancePoint& point : distance_curve(*sequence)) {
      file << fmt::format("{} {:.4f} {:.4f} {:.4f} {:.1f}\n", point.distance, point.low,
                          point.middle, point.high, point.epipolar);
      if (std::has_single_bit(point.distance)) {
        fmt::print("  {}: {:.2f} {:.2f} {:.2f}", point.distance, point.low, point.middle,
                   point.high);
      }
    }
    fmt::print("\n");
  }
}

/// What each rule says of unrelated frames, of neighbours, and of what the yardstick will say.
std::string compare_rules(const Options& options, const Sequences& sequences) {
  std::string results;
  fmt::print(
      "\nrules: share matched of unrelated frames (99 % of {} pairs are below), then by "
      "sequence: share\n  matched of neighbours (95 % are above), rank correlation with "
      "epipolar inliers\n",
      kNoisePairs);
  for (const Rule& rule : kRules) {
    fmt::print("  {:<30}", rule.name);
    const bool is_m = &rule == &kRules.back();
    if (sequences.size() > 1) {
      const auto noise = noise_floor(rule, sequences, kNoisePairs, options.seed);
      fmt::print("  unrelated {:.3f}", percentile(noise, 99));
      if (is_m) results += fmt::format("RESULT sim.noise_p99 {:.4f}\n", percentile(noise, 99));
    }
    for (const auto& sequence : sequences) {
      const double low = percentile(neighbours(rule, *sequence), 5);
      const double correlation = rank_correlation(rule, *sequence);
      fmt::print("  {} {:.2f} {:.3f}", sequence->name(), low, correlation);
      if (!is_m) continue;
      results += fmt::format(
          "RESULT sim.{0}.neighbours_p5 {1:.3f}\nRESULT sim.{0}.rank_correlation "
          "{2:.3f}\n",
          sequence->name(), low, correlation);
    }
    fmt::print("\n");
  }
  return results;
}

std::string results_of(const std::string& prefix, const Summary& summary) {
  return fmt::format(
      "RESULT {0}.worst_similarity {1:.1f}\nRESULT {0}.broken_share {2:.3f}\n"
      "RESULT {0}.longest_gap {3:.2f}\nRESULT {0}.vs_clairvoyant {4:.3f}\n"
      "RESULT {0}.epipolar_worst {5:.1f}\n",
      prefix, summary.worst_similarity, summary.broken_share, summary.longest_gap,
      summary.vs_clairvoyant, summary.epipolar_worst);
}

void print_row(const std::string& name, const Summary& row, double where_dropped) {
  fmt::print("  {:<14} {:10.1f} {:7.1f}% {:12.2f} {:13.3f} {:13.3f} {:9.1f}\n", name,
             row.worst_similarity, 100 * row.broken_share, row.longest_gap, row.vs_clairvoyant,
             where_dropped, row.epipolar_worst);
}

std::string try_policies(const Options& options, RecordedSequence& sequence) {
  const std::vector<Outage> outages = draw_outages(sequence, options.outages, options.seed);
  std::ofstream file = open(options, "policies_" + sequence.name() + ".dat");
  std::string results;
  Trial orbbuf;
  for (const Contender& contender : contenders()) {
    const Trial trial = run(sequence, contender, outages);
    if (results.empty()) {
      fmt::print(
          "\n{}: {} outages, {} of which cost frames; means\n  {:<14} {:>10} {:>8} {:>12} "
          "{:>13} {:>13} {:>9}\n",
          sequence.name(), outages.size(), trial.dropped_in, "policy", "smallest M", "broken",
          "longest gap", "/clairvoyant", "..if dropped", "epipolar");
    }
    if (contender.name == "orbbuf") orbbuf = trial;
    print_row(contender.name, trial.policy, trial.vs_where_dropped);
    file << fmt::format("{} {:.4f} {:.4f} {:.2f} {:.2f}\n", contender.name,
                        trial.policy.vs_clairvoyant, trial.policy.broken_share,
                        trial.policy.worst_similarity, trial.policy.epipolar_worst);
    results += results_of(fmt::format("sim.{}.{}", sequence.name(), contender.name), trial.policy);
  }
  print_row("clairvoyant", orbbuf.clairvoyant, 1);
  return results +
         results_of(fmt::format("sim.{}.clairvoyant", sequence.name()), orbbuf.clairvoyant);
}

void run_all(const Options& options) {
  std::filesystem::create_directories(options.plots);
  const Sequences sequences = load(options);
  draw_distances(options, sequences);
  std::string results = compare_rules(options, sequences);
  for (const auto& sequence : sequences) results += try_policies(options, *sequence);
  fmt::print("\nseed {}, {} outages for each buffer and rate\n{}", options.seed, options.outages,
             results);
}

}  // namespace
}  // namespace orbbuf::sim

int main(int argc, char** argv) {
  orbbuf::sim::Options options;
  CLI::App app("Every drop policy over recorded sequences and simulated outages");
  app.add_option("--data", options.data, "folder of sequences")->required();
  app.add_option("--plots", options.plots, "folder for what gnuplot reads")->required();
  app.add_option("--outages", options.outages, "for each buffer and rate")->capture_default_str();
  app.add_option("--seed", options.seed, "of the outages")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    orbbuf::sim::run_all(options);
  } catch (const std::exception& error) {
    fmt::print(stderr, "orbbuf-sim: {}\n", error.what());
    return 1;
  }
  return 0;
}
