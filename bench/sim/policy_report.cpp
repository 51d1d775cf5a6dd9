// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/policy_report.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <fstream>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "bench/sim/stage.hpp"
#include "bench/sim/trial.hpp"

namespace orbbuf::sim {
namespace {

using Stat = double OutageStats::*;

constexpr double kTailS = 16;  // played behind the sequence's end
constexpr double kRounding = 1e-6;
const std::vector<double> kBuffersS = {0.25, 0.5, 1};
const std::vector<double> kCurveBuffersS = {0.25, 0.5, 1, 2};
const std::vector<double> kRates = {1.2, 3};

std::ofstream open(const std::filesystem::path& path) {
  std::ofstream file(path);
  if (!file) throw std::runtime_error("cannot write " + path.string());
  return file;
}

/// Some of the outages, by index.
using Choice = std::vector<std::size_t>;

Choice choose(const std::vector<Outage>& outages, double buffer_s, double rate = 0) {
  Choice choice;
  for (std::size_t i = 0; i < outages.size(); ++i) {
    if (outages[i].buffer_s != buffer_s || (rate > 0 && outages[i].rate != rate)) continue;
    choice.push_back(i);
  }
  return choice;
}

double mean(const Column& column, const Choice& choice, Stat stat) {
  double sum = 0;
  for (const std::size_t i : choice) sum += column.runs[i].*stat;
  return sum / static_cast<double>(choice.size());
}

/// In how many of the runs, in per cent, one's stat is worse than the other's: larger, or with a
/// sign of -1 smaller.
double worse_share(const Column& one, const Column& other, const Choice& choice, Stat stat,
                   double sign) {
  double worse = 0;
  for (const std::size_t i : choice) {
    worse += sign * (one.runs[i].*stat - other.runs[i].*stat) > kRounding ? 1 : 0;
  }
  return 100 * worse / static_cast<double>(choice.size());
}

std::string worse_than(const Column& one, const Column& other, const Choice& choice) {
  return fmt::format("{:4.0f} {:3.0f} {:3.0f}",
                     worse_share(one, other, choice, &OutageStats::largest_step_s, 1),
                     worse_share(one, other, choice, &OutageStats::largest_motion, 1),
                     worse_share(one, other, choice, &OutageStats::smallest_similarity, -1));
}

/// Runs that are live again more than a tenth and one frame after what was asked for, in per cent.
double late_share(const Column& column, const Column& reference, const Choice& choice,
                  double interval_s) {
  double late = 0;
  for (const std::size_t i : choice) {
    late += column.runs[i].live_again_s > 1.1 * reference.runs[i].live_again_s + interval_s ? 1 : 0;
  }
  return 100 * late / static_cast<double>(choice.size());
}

const Column& find(const std::vector<Column>& columns, std::string_view name) {
  return *std::ranges::find(columns, name, &Column::name);
}

std::string row(const Column& column, const std::vector<Column>& columns, const Choice& choice,
                double interval_s) {
  const auto of = [&](Stat stat) { return mean(column, choice, stat); };
  return fmt::format(
      "  {:<16} {:6.2f} {:6.3f} {:5.1f} {:6.3f} {:6.1f} {:6.3f} {:6.3f} {:4.0f}   {:5.3f} {:5.3f} "
      "{:5.3f}  {} {}\n",
      column.name, of(&OutageStats::longest_gap), of(&OutageStats::largest_step_s),
      of(&OutageStats::mean_quality), of(&OutageStats::largest_motion),
      of(&OutageStats::smallest_similarity), of(&OutageStats::jump), of(&OutageStats::live_again_s),
      late_share(column, find(columns, "drop-oldest"), choice, interval_s),
      of(&OutageStats::vs_oracle), of(&OutageStats::vs_oracle_motion),
      of(&OutageStats::vs_oracle_similarity), worse_than(column, find(columns, "uniform"), choice),
      worse_than(column, find(columns, "orbbuf"), choice));
}

std::string results_of(const std::string& sequence, const Column& column, const Choice& choice,
                       double buffer_s) {
  std::string results;
  const auto add = [&](const char* what, Stat stat) {
    results += fmt::format("RESULT sim.{}.{}.{}.{} {:.4f}\n", sequence, column.name, what, buffer_s,
                           mean(column, choice, stat));
  };
  add("longest_gap", &OutageStats::longest_gap);
  add("largest_step", &OutageStats::largest_step_s);
  add("mean_quality", &OutageStats::mean_quality);
  add("largest_motion", &OutageStats::largest_motion);
  add("worst_similarity", &OutageStats::smallest_similarity);
  add("jump", &OutageStats::jump);
  add("live_again_s", &OutageStats::live_again_s);
  if (column.name.starts_with("oracle")) return results;
  add("vs_oracle", &OutageStats::vs_oracle);
  if (column.name == "catch-up") add("vs_oracle_quality", &OutageStats::vs_oracle_quality);
  add("vs_oracle_motion", &OutageStats::vs_oracle_motion);
  if (column.name == "orbbuf") add("vs_fifo_oracle", &OutageStats::vs_fifo_oracle);
  return results;
}

void add_table(PolicyReport& report, const RecordedSequence& sequence,
               const std::vector<Outage>& outages, const std::vector<Column>& columns,
               double buffer_s) {
  const Choice choice = choose(outages, buffer_s);
  report.text += fmt::format(
      "\n{}: as late as a FIFO of {} s, {} outages; means\n"
      "  {:<16} {:>6} {:>6} {:>5} {:>6} {:>6} {:>6} {:>6} {:>4}   {:^17}   worse than, % of "
      "outages, by\n"
      "  {:<16} {:>6} {:>6} {:>5} {:>6} {:>6} {:>6} {:>6} {:>4}   {:>5} {:>5} {:>5}   uniform     "
      "orbbuf\n",
      sequence.name(), buffer_s, choice.size(), "", "", "step", "qual", "motion", "least", "",
      "live", "late", "oracle / own, by", "policy", "gap", "s", "ity", "widths", "M", "jump", "s",
      "%", "time", "motn", "M");
  const double interval_s = 1e-9 * sequence.mean_interval_ns();
  for (const Column& column : columns) {
    report.text += row(column, columns, choice, interval_s);
    report.results += results_of(sequence.name(), column, choice, buffer_s);
  }
}

/// How the planner's mean gap compares with the baselines', and how the oracle's does.
void add_comparison(PolicyReport& report, const RecordedSequence& sequence,
                    const std::vector<Outage>& outages, const std::vector<Column>& columns,
                    double buffer_s) {
  const Choice choice = choose(outages, buffer_s);
  const auto gap_of = [&](std::string_view name) {
    return mean(find(columns, name), choice, &OutageStats::longest_gap);
  };
  for (const char* baseline : {"catch-up-full", "uniform", "orbbuf"}) {
    const double own = gap_of("catch-up") / gap_of(baseline);
    report.text += fmt::format("  longest gap as a share of {}'s: catch-up {:.2f}, oracle {:.2f}\n",
                               baseline, own, gap_of("oracle") / gap_of(baseline));
    report.results += fmt::format("RESULT sim.{}.catch-up.gap_vs_{}.{} {:.3f}\n", sequence.name(),
                                  baseline, buffer_s, own);
  }
  const double bytes = mean(find(columns, "catch-up"), choice, &OutageStats::bytes) /
                       mean(find(columns, "catch-up-full"), choice, &OutageStats::bytes);
  report.text += fmt::format("  bytes as a share of catch-up-full's: {:.3f}\n", bytes);
  report.results += fmt::format("RESULT sim.{}.catch-up.bytes_vs_full.{} {:.3f}\n", sequence.name(),
                                buffer_s, bytes);
}

/// For the histogram of plots.gp.
void write_policies(const RecordedSequence& sequence, const std::vector<Outage>& outages,
                    const std::vector<Column>& columns, const std::filesystem::path& plots) {
  std::ofstream file = open(plots / ("policies_" + sequence.name() + ".dat"));
  const Choice choice = choose(outages, kBuffersS.back());
  for (const Column& column : columns) {
    if (column.name.starts_with("oracle")) continue;
    file << fmt::format("{} {:.4f}\n", column.name, mean(column, choice, &OutageStats::vs_oracle));
  }
}

void add_curve(PolicyReport& report, const RecordedSequence& sequence,
               const std::vector<Outage>& outages, const std::vector<Column>& columns,
               const std::filesystem::path& plots) {
  std::ofstream file = open(plots / ("curve_" + sequence.name() + ".dat"));
  report.text += fmt::format("\n{}: seconds until live again: longest gap, largest step in s\n",
                             sequence.name());
  for (const double rate : kRates) {
    for (const Column& column : columns) {
      report.text += fmt::format("  {:3} x {:<16}", rate, column.name);
      for (const double buffer_s : kCurveBuffersS) {
        const Choice choice = choose(outages, buffer_s, rate);
        const double live_s = mean(column, choice, &OutageStats::live_again_s);
        const double gap = mean(column, choice, &OutageStats::longest_gap);
        const double step_s = mean(column, choice, &OutageStats::largest_step_s);
        report.text += fmt::format("  {:5.2f}: {:5.2f} {:5.3f}", live_s, gap, step_s);
        file << fmt::format("{} {} {:.4f} {:.4f} {:.4f}\n", rate, column.name, live_s, gap, step_s);
      }
      report.text += "\n";
    }
  }
}

}  // namespace

PolicyReport report_policies(RecordedSequence& sequence, std::size_t outages, std::uint64_t seed,
                             const std::filesystem::path& plots) {
  const double length_s = 1e-9 * static_cast<double>(sequence.frames().back()->capture_time_ns);
  Stage stage(sequence, length_s + kTailS);
  PolicyReport report;
  const auto drawn = draw_outages(sequence, kBuffersS, kRates, outages, seed);
  const std::vector<Column> columns = run(stage, drawn);
  for (const double buffer_s : kBuffersS) {
    add_table(report, sequence, drawn, columns, buffer_s);
    add_comparison(report, sequence, drawn, columns, buffer_s);
  }
  write_policies(sequence, drawn, columns, plots);
  const auto fewer = draw_outages(sequence, kCurveBuffersS, kRates, (outages + 2) / 3, seed);
  add_curve(report, sequence, fewer, run(stage, fewer), plots);
  return report;
}

}  // namespace orbbuf::sim
