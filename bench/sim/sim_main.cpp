// SPDX-License-Identifier: Apache-2.0
// orbbuf-sim: every policy over every sequence through many outages, and over recorded links, on a
// virtual clock, beside oracles; and what M says of frames. Prints tables, then RESULT lines.
#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <string>
#include <vector>

#include "bench/run_program.hpp"
#include "bench/sim/curves.hpp"
#include "bench/sim/links.hpp"
#include "bench/sim/policy_report.hpp"
#include "bench/sim/stage.hpp"
#include "bench/sim/trial.hpp"
#include "common/command_line.hpp"

namespace orbbuf::sim {
namespace {

constexpr std::size_t kNoisePairs = 1000;
constexpr double kLongestLinkS = 1000;  // for which M is at hand

struct Options {
  std::filesystem::path data;
  std::vector<std::filesystem::path> sequences;  // beside those in data
  std::filesystem::path traces;
  std::filesystem::path plots;
  std::size_t outages = 100;
  std::uint64_t seed = 1;
  bool is_quick = false;
};

/// A folder with images/ and, if the camera had a clock, times.txt.
std::unique_ptr<RecordedSequence> load_folder(const std::filesystem::path& folder) {
  SourceSettings source;
  source.kind = "folder";
  source.path = folder / "images";
  const auto name = (folder / ".").lexically_normal().parent_path().filename();
  return std::make_unique<RecordedSequence>(name.string(), source);
}

Sequences load(const Options& options) {
  std::vector<std::filesystem::path> folders;
  for (const char* name : {"kitti05_stereo", "kitti06_mono", "picar_indoor", "tsukuba_synth"}) {
    const auto folder = options.data / name;
    if (exists(folder)) {
      folders.push_back(folder);
    } else {
      fmt::print("skipped: no {}\n", folder.string());
    }
  }
  folders.insert(folders.end(), options.sequences.begin(), options.sequences.end());
  std::vector<std::future<std::unique_ptr<RecordedSequence>>> loading;
  loading.reserve(folders.size());
  for (const auto& folder : folders) {
    loading.push_back(std::async(std::launch::async, load_folder, folder));
  }
  Sequences sequences;
  for (auto& future : loading) sequences.push_back(future.get());
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
  std::vector<std::future<std::vector<DistancePoint>>> curves;
  for (const auto& sequence : sequences) {
    curves.push_back(std::async(std::launch::async,
                                [&sequence = *sequence] { return distance_curve(sequence); }));
  }
  for (std::size_t at = 0; const auto& sequence : sequences) {
    const auto curve = curves[at++].get();
    fmt::print("  {:<15} M(a, a) {:3.0f}", sequence->name(), sequence->self_similarity());
    std::ofstream file = open(options, "distance_" + sequence->name() + ".dat");
    for (const DistancePoint& point : curve) {
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

/// Each in a thread of its own, since each sequence remembers what it has computed.
std::string try_policies(const Options& options, const Sequences& sequences) {
  std::vector<std::future<PolicyReport>> reports;
  for (const auto& sequence : sequences) {
    reports.push_back(std::async(std::launch::async, [&options, &sequence = *sequence] {
      return report_policies(sequence, options.outages, options.seed, options.plots);
    }));
  }
  std::string results;
  for (auto& future : reports) {
    const PolicyReport report = future.get();
    fmt::print("{}", report.text);
    results += report.results;
  }
  return results;
}

/// Of the bytes of a frame, what is left at a quality: the mean over all frames.
std::function<double(int quality)> mean_share(const Sequences& sequences) {
  std::vector<double> shares;  // from RecordedSequence::kLeastQuality on
  for (int quality = RecordedSequence::kLeastQuality; quality <= kQuality; ++quality) {
    double sum = 0;
    double count = 0;
    for (const auto& sequence : sequences) {
      for (std::size_t i = 0; i < sequence->size(); ++i, ++count) {
        sum += static_cast<double>(sequence->bytes_at(i, quality)) /
               static_cast<double>(sequence->frame(i)->jpeg.size());
      }
    }
    shares.push_back(sum / count);
  }
  return [shares](int quality) {
    return shares.at(static_cast<std::size_t>(quality - RecordedSequence::kLeastQuality));
  };
}

void run_all(const Options& options) {
  std::filesystem::create_directories(options.plots);
  const Sequences sequences = load(options);
  std::string results;
  if (!options.is_quick) {
    draw_distances(options, sequences);
    results += compare_rules(options, sequences);
  }
  results += try_policies(options, sequences);
  Stage generated(*sequences.back(), kLongestLinkS);
  results += try_links(options.traces, mean_share(sequences),
                       [&](std::size_t i, std::size_t j) { return generated.similarity(i, j); });
  fmt::print("\nseed {}, {} outages for each buffer and rate\n{}", options.seed, options.outages,
             results);
}

}  // namespace
}  // namespace orbbuf::sim

int main(int argc, char** argv) {
  orbbuf::sim::Options options;
  orbbuf::CommandLine app("Every drop policy over recorded sequences and simulated outages");
  app.add_option("--data", options.data, "folder of sequences").required();
  app.add_option("--sequence", options.sequences, "a folder of one more: images/, times.txt");
  app.add_option("--traces", options.traces, "folder of recorded links").required();
  app.add_option("--plots", options.plots, "folder for what gnuplot reads").required();
  app.add_option("--outages", options.outages, "for each buffer and rate").with_default();
  app.add_option("--seed", options.seed, "of the outages").with_default();
  app.add_flag("--quick", options.is_quick, "the policies only, not what M says of frames");
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("orbbuf-sim", [&] { orbbuf::sim::run_all(options); });
}
