// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <stdexcept>

#include "evaluation/trial/experiments.hpp"
#include "evaluation/trial/report.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr std::size_t kMost = 75;   // frames in a row, the most that we try
constexpr std::size_t kUntil = 10;  // frames after the gap, twice the patience of the reference VO
constexpr std::size_t kLead = 50;
constexpr std::array<std::size_t, 12> kDistances = {1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64};
constexpr std::size_t kPairsApart = 8;  // each eighth frame begins a pair

bool stands(const Scene& scene, std::size_t first, std::size_t missing) {
  std::vector<std::size_t> received(first);
  std::iota(received.begin(), received.end(), 0);
  for (std::size_t i = first + missing; i < first + missing + kUntil; ++i) received.push_back(i);
  return !scene.track(received, first + missing + kUntil).is_lost();
}

/// The smallest number of missing frames that loses the reference VO, by halving; kMost + 1: none.
std::size_t tolerance(const Scene& scene, std::size_t first) {
  std::size_t stood = 0;
  std::size_t lost = kMost + 1;
  while (lost - stood > 1) {
    const std::size_t middle = (stood + lost) / 2;
    (stands(scene, first, middle) ? stood : lost) = middle;
  }
  return lost;
}

void write_distances(Scene& scene, const TrialOptions& options) {
  std::string csv = "distance,pairs,mean,lowest\n";
  for (const std::size_t distance : kDistances) {
    double sum = 0;
    int lowest = 1000;
    std::size_t pairs = 0;
    for (std::size_t i = 0; i + distance < scene.size(); i += kPairsApart, ++pairs) {
      const int value = scene.sequence().similarity(i, i + distance);
      sum += value;
      lowest = std::min(lowest, value);
    }
    if (pairs == 0) break;
    csv +=
        fmt::format("{},{},{:.2f},{}\n", distance, pairs, sum / static_cast<double>(pairs), lowest);
  }
  write_text(options.out / "similarity.csv", csv);
}

}  // namespace

std::string try_tolerance(Scene& scene, const TrialOptions& options) {
  constexpr std::size_t kLeast = kLead + kMost + kUntil;
  if (scene.size() <= kLeast) {
    throw std::runtime_error(
        fmt::format("tolerance needs more than {} frames, not {}", kLeast, scene.size()));
  }
  write_distances(scene, options);
  const std::size_t places = 2 * options.places;
  const std::size_t room = scene.size() - kLeast;
  std::vector<std::size_t> found(places);
  std::vector<std::size_t> firsts(places);
  for (std::size_t i = 0; i < places; ++i) firsts[i] = kLead + i * room / places;
  for_each_parallel("tolerance", places,
                    [&](std::size_t i) { found[i] = tolerance(scene, firsts[i]); });
  std::string csv = "first,frames\n";
  for (std::size_t i = 0; i < places; ++i) csv += fmt::format("{},{}\n", firsts[i], found[i]);
  write_text(options.out / "tolerance.csv", csv);
  std::ranges::sort(found);
  write_text(
      options.out / "tolerance.md",
      fmt::format("| frames in a row that lose the reference VO | smallest | a quarter of the "
                  "places | half | three quarters | stand {} |\n|---|---|---|---|---|---|\n"
                  "| at {} places | {} | {} | {} | {} | {} |\n",
                  kMost, places, found.front(), found[places / 4], found[places / 2],
                  found[places * 3 / 4], std::ranges::count(found, kMost + 1)));
  return fmt::format("RESULT paper.tolerance.smallest {}\nRESULT paper.tolerance.median {}\n",
                     found.front(), found[places / 2]);
}

}  // namespace orbbuf::evaluation
