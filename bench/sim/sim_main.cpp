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
#include "bench/sim/links.hpp"
#include "bench/sim/trial.hpp"

namespace orbbuf::sim {
namespace {

constexpr std::size_t kNoisePairs = 1000;
constexpr double kTailS = 12;           // played behind the sequence's end
constexpr double kLongestLinkS = 1000;  // for which M is at hand
const std::vector<double> kBuffersS = {0.5, 1};
const std::vector<double> kRates = {1.2, 3};

struct Options {
  std::filesystem::path data;
  std::filesystem::path traces;
  std::filesystem::path plots;
  std::size_t outages = 150;
  std::uint64_t seed = 1;
  bool is_quick = false;
};

Sequences load(const Options& options) {
  Sequences sequences;
  for (const char* name : {"kitti05_stereo", "kitti06_mono", "picar_indoor", "tsukuba_synth"}) {
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

/// The mean of one figure over the runs at this lateness.
double mean(const std::vector<Figures>& runs, const std::vector<Outage>& outages, double buffer_s,
            double Figures::*figure) {
  double sum = 0;
  double count = 0;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (outages[i].buffer_s != buffer_s) continue;
    sum += runs[i].*figure;
    ++count;
  }
  return sum / count;
}

/// In how many of the runs at this lateness one is worse than the other: by more than a rounding.
double worse_share(const Column& one, const Column& other, const std::vector<Outage>& outages,
                   double buffer_s, double Figures::*figure, double sign) {
  double worse = 0;
  double count = 0;
  for (std::size_t i = 0; i < outages.size(); ++i) {
    if (outages[i].buffer_s != buffer_s) continue;
    worse += sign * (one.runs[i].*figure - other.runs[i].*figure) > 1e-6 ? 1 : 0;
    ++count;
  }
  return 100 * worse / count;
}

const Column& find(const std::vector<Column>& columns, std::string_view name) {
  return *std::ranges::find(columns, name, &Column::name);
}

/// In per cent of the outages, by time, motion and M.
std::string worse_than(const Column& one, const Column& other, const std::vector<Outage>& outages,
                       double buffer_s) {
  return fmt::format("{:4.0f} {:3.0f} {:3.0f}",
                     worse_share(one, other, outages, buffer_s, &Figures::largest_step_s, 1),
                     worse_share(one, other, outages, buffer_s, &Figures::largest_motion, 1),
                     worse_share(one, other, outages, buffer_s, &Figures::smallest_similarity, -1));
}

std::string try_policies(const Options& options, RecordedSequence& sequence) {
  const std::vector<Outage> outages =
      draw_outages(sequence, kBuffersS, kRates, options.outages, options.seed);
  const double length_s = 1e-9 * static_cast<double>(sequence.frames().back()->capture_time_ns);
  Stage stage(sequence, length_s + kTailS);
  const std::vector<Column> columns = run(stage, outages);
  std::string text;
  std::string results;
  for (const double buffer_s : kBuffersS) {
    text += fmt::format(
        "\n{}: as late as a FIFO of {} s, {} outages; means\n  {:<15} {:>7} {:>7} {:>7} {:>6} "
        "{:>6} {:>7} {:>24} {:>14} {:>14}\n",
        sequence.name(), buffer_s, outages.size() / kBuffersS.size(), "policy", "gap", "step s",
        "motion", "min M", "jump", "live s", "oracle by time, motion, M", "worse: uniform",
        "orbbuf, %");
    for (const Column& column : columns) {
      const auto mean_of = [&](double Figures::*figure) {
        return mean(column.runs, outages, buffer_s, figure);
      };
      text += fmt::format(
          "  {:<15} {:7.2f} {:7.3f} {:7.3f} {:6.1f} {:6.3f} {:7.3f}       {:5.3f} {:5.3f} {:5.3f} "
          "  {}    {}\n",
          column.name, mean_of(&Figures::longest_gap), mean_of(&Figures::largest_step_s),
          mean_of(&Figures::largest_motion), mean_of(&Figures::smallest_similarity),
          mean_of(&Figures::jump), mean_of(&Figures::live_again_s), mean_of(&Figures::vs_oracle),
          mean_of(&Figures::vs_oracle_motion), mean_of(&Figures::vs_oracle_similarity),
          worse_than(column, find(columns, "uniform"), outages, buffer_s),
          worse_than(column, find(columns, "orbbuf"), outages, buffer_s));
      results += fmt::format(
          "RESULT sim.{0}.{1}.longest_gap.{2} {3:.3f}\nRESULT sim.{0}.{1}.largest_step.{2} "
          "{4:.4f}\n",
          sequence.name(), column.name, buffer_s, mean_of(&Figures::longest_gap),
          mean_of(&Figures::largest_step_s));
      if (column.name.starts_with("oracle")) continue;
      results += fmt::format("RESULT sim.{0}.{1}.vs_oracle.{2} {3:.4f}\n", sequence.name(),
                             column.name, buffer_s, mean_of(&Figures::vs_oracle));
    }
  }
  fmt::print("{}", text);
  return results;
}

void run_all(const Options& options) {
  std::filesystem::create_directories(options.plots);
  const Sequences sequences = load(options);
  std::string results;
  if (!options.is_quick) {
    draw_distances(options, sequences);
    results += compare_rules(options, sequences);
  }
  for (const auto& sequence : sequences) results += try_policies(options, *sequence);
  Stage generated(*sequences.back(), kLongestLinkS);
  results += try_links(options.traces,
                       [&](std::size_t i, std::size_t j) { return generated.similarity(i, j); });
  fmt::print("\nseed {}, {} outages for each buffer and rate\n{}", options.seed, options.outages,
             results);
}

}  // namespace
}  // namespace orbbuf::sim

int main(int argc, char** argv) {
  orbbuf::sim::Options options;
  CLI::App app("Every drop policy over recorded sequences and simulated outages");
  app.add_option("--data", options.data, "folder of sequences")->required();
  app.add_option("--traces", options.traces, "folder of recorded links")->required();
  app.add_option("--plots", options.plots, "folder for what gnuplot reads")->required();
  app.add_option("--outages", options.outages, "for each buffer and rate")->capture_default_str();
  app.add_option("--seed", options.seed, "of the outages")->capture_default_str();
  app.add_flag("--quick", options.is_quick, "the policies only, not what M says of frames");
  CLI11_PARSE(app, argc, argv);
  try {
    orbbuf::sim::run_all(options);
  } catch (const std::exception& error) {
    fmt::print(stderr, "orbbuf-sim: {}\n", error.what());
    return 1;
  }
  return 0;
}
