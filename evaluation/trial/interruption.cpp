// SPDX-License-Identifier: Apache-2.0
// Outages of a link that is otherwise fast enough: who survives, and how much buffer that takes.
#include <fmt/core.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <fstream>
#include <random>
#include <set>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "bench/sim/simulation.hpp"
#include "bench/sim/trial.hpp"
#include "evaluation/random.hpp"
#include "evaluation/trial/experiments.hpp"
#include "evaluation/trial/report.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kLeadS = 2;  // until the reference VO has its first map, and some more
constexpr double kSurvive = 0.95;
constexpr double kBufferOutageS = 3;
constexpr std::size_t kBufferStep = 5;
constexpr std::size_t kLargestBuffer = 95;

struct Place {
  double begin_s = 0;
  double outage_s = 0;
  std::uint64_t seed = 0;
};

/// Evenly along the way, each up to half a step aside.
std::vector<Place> draw_places(const Scene& scene, const TrialOptions& options, double outage_s) {
  std::mt19937_64 random(options.seed);
  const double first_s = kLeadS;
  const double length_s = static_cast<double>(scene.size()) / scene.fps();
  const double step_s =
      (length_s - outage_s - kScoredAfterS - first_s) / static_cast<double>(options.places);
  if (step_s <= 0) {
    throw std::runtime_error(fmt::format("an outage of {} s needs more than {} s, not {:.1f}",
                                         outage_s, first_s + outage_s + kScoredAfterS, length_s));
  }
  std::vector<Place> places;
  for (std::size_t i = 0; i < options.places; ++i) {
    const double begin_s = first_s + step_s * (static_cast<double>(i) + uniform(random, 0, 1));
    places.push_back({begin_s, outage_s, random()});
  }
  return places;
}

/// One outage, and what came of it.
struct Run {
  std::string policy;
  Place place;
  std::vector<std::size_t> received;
  Stretch stretch;
  std::size_t gap =
      0;             ///< most frames in a row that are missing; to the end if no frame came after
  int smallest = 0;  ///< similarity between neighbours
  bool survived = false;
};

Run simulate_run(Scene& scene, std::string_view policy, const Place& place, double rate,
                 sim::Setup setup) {
  sim::RecordedSequence& sequence = scene.sequence();
  const sim::LinkModel link{rate * sequence.mean_jpeg_bytes() * scene.fps(),
                            std::llround(place.begin_s * 1e9),
                            std::llround((place.begin_s + place.outage_s) * 1e9)};
  setup.seed = place.seed;
  setup.similarity = [&](std::size_t i, std::size_t j) { return sequence.similarity(i, j); };
  const auto delivery = sim::simulate(sequence.frames(), link, sim::contender(policy).make(setup));
  Run run{std::string(policy), place, {}, {}, 0, 0, false};
  run.stretch.begin =
      static_cast<std::size_t>(std::max(0.0, (place.begin_s - kScoredBeforeS) * scene.fps()));
  run.stretch.end = std::min(
      scene.size(),
      static_cast<std::size_t>((place.begin_s + place.outage_s + kScoredAfterS) * scene.fps()));
  run.received = scene.only_in(delivery.received, run.stretch);
  run.gap = longest_gap(run.received, run.stretch);
  run.smallest = 1000;
  for (std::size_t k = run.stretch.begin + 1; k < run.received.size(); ++k) {
    run.smallest =
        std::min(run.smallest, sequence.similarity(run.received[k - 1], run.received[k]));
  }
  return run;
}

void score_all(const Scene& scene, const std::string& name, std::vector<Run>& runs) {
  for_each_parallel(name, runs.size(), [&](std::size_t i) {
    runs[i].survived = scene.survives(runs[i].received, runs[i].stretch);
  });
}

Share survivors(const std::vector<Run>& runs, std::string_view policy, double outage_s) {
  Share share;
  for (const Run& run : runs) {
    if (run.policy != policy || (outage_s > 0 && run.place.outage_s != outage_s)) continue;
    ++share.all;
    share.some += run.survived ? 1 : 0;
  }
  return share;
}

/// Rows are policies, columns outages.
std::string table(const std::vector<Run>& runs, const TrialOptions& options) {
  std::string text = "| policy |";
  std::string line = "\n|---|";
  for (const double outage_s : options.outages_s) {
    text += fmt::format(" {} s |", outage_s);
    line += "---|";
  }
  text += " all |" + line + "---|\n";
  for (const std::string& policy : options.policies) {
    text += fmt::format("| {} |", policy);
    for (const double outage_s : options.outages_s) {
      text += fmt::format(" {} |", to_text(survivors(runs, policy, outage_s)));
    }
    text += fmt::format(" {} |\n", to_text(survivors(runs, policy, 0)));
  }
  return text;
}

/// True if enough of the places survive with a buffer of so many frames.
bool is_enough(Scene& scene, std::string_view policy, const std::vector<Place>& places,
               std::size_t capacity, double rate) {
  sim::Setup setup;
  setup.capacity = capacity;
  // So long a full buffer takes to empty while the camera goes on.
  setup.live_again = std::chrono::nanoseconds(
      std::llround(static_cast<double>(capacity) / scene.fps() / (rate - 1) * 1e9));
  setup.largest_step = std::chrono::hours(1);
  std::vector<Run> runs;
  runs.reserve(places.size());
  for (const Place& place : places) {
    runs.push_back(simulate_run(scene, policy, place, rate, setup));
  }
  const double may_fail = (1 - kSurvive) * static_cast<double>(places.size()) + 1e-9;
  std::atomic<int> failed = 0;
  for_each_parallel(fmt::format("buffer of {} under {}", capacity, policy), runs.size(),
                    [&](std::size_t i) {
                      if (failed > may_fail) return;  // that is decided
                      if (!scene.survives(runs[i].received, runs[i].stretch)) ++failed;
                    });
  return failed <= may_fail;
}

/// One outage of a real session. The outage's length is known to the half second.
Run run_of(const Scene& scene, const Session& session, const Outage& outage) {
  Run run;
  run.policy = session.contender;
  run.place = {outage.begin / scene.fps(),
               std::round(2 * (outage.end - outage.begin) / scene.fps()) / 2, 0};
  const auto stretch = stretch_around(outage, session.received, scene.fps(), scene.size());
  if (!stretch) {
    const auto begin = static_cast<std::size_t>(std::max(0.0, outage.begin));
    run.gap = longest_gap(session.received, {begin, scene.size()});
    return run;
  }
  run.stretch = *stretch;
  run.received = scene.only_in(session.received, run.stretch);
  run.gap = longest_gap(run.received, run.stretch);
  return run;
}

/// Each pair that there are runs of, in order.
std::set<std::pair<std::string, double>> policies_and_outages(const std::vector<Run>& runs) {
  std::set<std::pair<std::string, double>> pairs;
  for (const Run& run : runs) pairs.emplace(run.policy, run.place.outage_s);
  return pairs;
}

/// A row for each policy and each length of outage.
std::string session_table(const std::vector<Run>& runs) {
  std::string text = "| | outages of | survived | longest gap, frames |\n|---|---|---|---|\n";
  for (const auto& [policy, outage_s] : policies_and_outages(runs)) {
    std::size_t gap = 0;
    for (const Run& run : runs) {
      if (run.policy == policy && run.place.outage_s == outage_s) gap = std::max(gap, run.gap);
    }
    const Share share = survivors(runs, policy, outage_s);
    text += fmt::format("| {} | {} s | {} of {}: {} | {} |\n", policy, outage_s, share.some,
                        share.all, to_text(share), gap);
  }
  return text;
}

}  // namespace

std::string try_interruptions(Scene& scene, const TrialOptions& options) {
  sim::Setup setup;
  setup.capacity = options.capacity;
  std::vector<Run> runs;
  for (const double outage_s : options.outages_s) {
    for (const Place& place : draw_places(scene, options, outage_s)) {
      for (const std::string& policy : options.policies) {
        runs.push_back(simulate_run(scene, policy, place, options.rate, setup));
      }
    }
  }
  score_all(scene, "interruptions", runs);
  std::string csv = "policy,outage_s,begin_s,longest_gap,smallest_similarity,survived\n";
  for (const Run& run : runs) {
    csv += fmt::format("{},{},{:.3f},{},{},{}\n", run.policy, run.place.outage_s, run.place.begin_s,
                       run.gap, run.smallest, run.survived ? 1 : 0);
  }
  write_text(options.out / "interruption.csv", csv);
  write_text(options.out / "interruption.md", table(runs, options));
  std::string results;
  std::string plot;
  for (const std::string& policy : options.policies) {
    const Share share = survivors(runs, policy, 0);
    const auto [low, high] = share.interval();
    plot += fmt::format("{} {:.4f} {:.4f} {:.4f}\n", policy, share.value(), low, high);
    results +=
        fmt::format("RESULT paper.interruption.{}.survived_share {:.4f}\n", policy, share.value());
  }
  write_text(options.out / "interruption.dat", plot);
  return results;
}

std::string try_buffers(Scene& scene, const TrialOptions& options) {
  const std::vector<Place> places = draw_places(scene, options, kBufferOutageS);
  std::string csv = "policy,capacity,is_enough\n";
  std::string markdown = fmt::format(
      "| policy | buffer needed for an outage of {} s, frames |\n|---|---|\n", kBufferOutageS);
  std::string results;
  for (const std::string& policy : options.policies) {
    // Halving: more buffer is taken to be no worse.
    std::size_t too_small = 0;
    std::size_t enough = kLargestBuffer + kBufferStep;
    while (enough - too_small > kBufferStep) {
      const std::size_t middle = too_small + (enough - too_small) / 2 / kBufferStep * kBufferStep;
      const std::size_t capacity = middle == too_small ? too_small + kBufferStep : middle;
      const bool suffices = is_enough(scene, policy, places, capacity, options.rate);
      csv += fmt::format("{},{},{}\n", policy, capacity, suffices ? 1 : 0);
      (suffices ? enough : too_small) = capacity;
    }
    if (enough > kLargestBuffer) {
      markdown += fmt::format("| {} | over {} |\n", policy, kLargestBuffer);
      continue;
    }
    markdown += fmt::format("| {} | {} |\n", policy, enough);
    results += fmt::format("RESULT paper.buffer.{}.needed {}\n", policy, enough);
  }
  write_text(options.out / "buffer.csv", csv);
  write_text(options.out / "buffer.md", markdown);
  return results;
}

std::string score_sessions(Scene& scene, const TrialOptions& options,
                           const std::filesystem::path& outages,
                           const std::vector<std::string>& sessions) {
  std::vector<Run> runs;
  for (const std::string& named : sessions) {
    const Session session = read_session(named);
    std::ifstream in(outages);
    std::string name;
    for (double begin = 0, end = 0; in >> name >> begin >> end;) {
      if (name == session.name) runs.push_back(run_of(scene, session, {begin, end}));
    }
  }
  score_all(scene, "sessions", runs);
  std::string csv = "name,begin_s,outage_s,longest_gap,survived\n";
  for (const Run& run : runs) {
    csv += fmt::format("{},{:.2f},{},{},{}\n", run.policy, run.place.begin_s, run.place.outage_s,
                       run.gap, run.survived ? 1 : 0);
  }
  write_text(options.out / "sessions.csv", csv);
  write_text(options.out / "sessions.md", session_table(runs));
  std::string results;
  for (const auto& [policy, outage_s] : policies_and_outages(runs)) {
    results += fmt::format("RESULT {}.{}.survived_share.{} {:.4f}\n", options.result, policy,
                           outage_s, survivors(runs, policy, outage_s).value());
  }
  return results;
}

}  // namespace orbbuf::evaluation
