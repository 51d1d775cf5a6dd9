// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/oracle.hpp"

#include <algorithm>
#include <limits>

namespace orbbuf::sim {
namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

/// The earliest-arrival recursion for one bound on the cost of a step.
class EarliestArrival {
 public:
  EarliestArrival(const OracleProblem& problem, const StepCost& cost, bool is_monotone)
      : problem_(problem), cost_(cost), is_monotone_(is_monotone), nodes_(problem.frames.size()) {
    Node& last = nodes_[problem.last];
    last.begin_ns = problem.last_begin_ns;
    last.end_ns = problem.finish(last.begin_ns, problem.last_bytes > 0
                                                    ? problem.last_bytes
                                                    : problem.frames[problem.last]->jpeg.size());
  }

  std::optional<OraclePath> path_within(double bound) {
    for (std::size_t j = problem_.last + 1; j < nodes_.size(); ++j) {
      if (capture_ns(j) > problem_.deadline_ns) break;
      reach(j, bound);
      if (is_live(j)) return path_to(j);
    }
    return std::nullopt;
  }

 private:
  struct Node {
    std::int64_t begin_ns = kNever;
    std::int64_t end_ns = kNever;
    std::size_t previous = 0;
    double cost = 0;
  };

  std::int64_t capture_ns(std::size_t j) const { return problem_.frames[j]->capture_time_ns; }

  void reach(std::size_t j, double bound) {
    Node& node = nodes_[j];
    node.end_ns = kNever;
    std::int64_t free_ns = kNever;
    for (std::size_t i = j; i-- > problem_.last;) {
      if (!is_monotone_ && nodes_[i].end_ns >= free_ns) continue;
      const double cost = cost_(i, j);
      if (cost > bound) {
        if (is_monotone_) break;
        continue;
      }
      if (nodes_[i].end_ns >= free_ns) continue;
      free_ns = nodes_[i].end_ns;
      node.previous = i;
      node.cost = cost;
    }
    if (free_ns == kNever) {
      node.begin_ns = kNever;
      return;
    }
    node.begin_ns = std::max(free_ns, capture_ns(j));
    node.end_ns = problem_.finish(
        node.begin_ns, problem_.bytes ? problem_.bytes(j) : problem_.frames[j]->jpeg.size());
  }

  bool is_live(std::size_t j) const {
    return nodes_[j].begin_ns <= problem_.deadline_ns &&
           (j + 1 == nodes_.size() || capture_ns(j + 1) >= nodes_[j].begin_ns);
  }

  OraclePath path_to(std::size_t j) const {
    OraclePath path;
    path.largest_cost = -std::numeric_limits<double>::infinity();
    for (; j != problem_.last; j = nodes_[j].previous) {
      path.frames.push_back(j);
      path.begin_ns.push_back(nodes_[j].begin_ns);
      path.largest_cost = std::max(path.largest_cost, nodes_[j].cost);
    }
    std::ranges::reverse(path.frames);
    std::ranges::reverse(path.begin_ns);
    return path;
  }

  const OracleProblem& problem_;
  const StepCost& cost_;
  const bool is_monotone_;
  std::vector<Node> nodes_;
};

}  // namespace

std::optional<OraclePath> oracle(const OracleProblem& problem, const StepCost& cost,
                                 bool is_monotone, double tolerance) {
  EarliestArrival search(problem, cost, is_monotone);
  std::optional<OraclePath> best = search.path_within(std::numeric_limits<double>::infinity());
  if (!best) return best;
  double too_small = best->largest_cost;  // a bound that is not enough, or is not yet known to be
  for (std::size_t i = problem.last; i + 1 < problem.frames.size(); ++i) {
    for (std::size_t j = i + 1; j < problem.frames.size(); ++j) {
      too_small = std::min(too_small, cost(i, j));
      if (is_monotone) break;
    }
  }
  if (auto path = search.path_within(too_small)) return path;
  while (best->largest_cost - too_small > tolerance) {
    const double middle = (too_small + best->largest_cost) / 2;
    if (auto path = search.path_within(middle)) {
      best = std::move(path);
    } else {
      too_small = middle;
    }
  }
  return best;
}

std::optional<QualityPath> oracle(OracleProblem problem, const BytesAt& bytes_at,
                                  std::span<const int> qualities, const StepCost& cost,
                                  bool is_monotone, double tolerance) {
  int quality = qualities.back();
  problem.bytes = [&](std::size_t frame) { return bytes_at(frame, quality); };
  const auto least = oracle(problem, cost, is_monotone, tolerance);
  if (!least) return std::nullopt;
  EarliestArrival search(problem, cost, is_monotone);
  for (const int higher : qualities) {
    quality = higher;
    auto path = search.path_within(least->largest_cost);
    if (path) return QualityPath{*std::move(path), quality};
  }
  return std::nullopt;  // not reached: the last one is possible
}

}  // namespace orbbuf::sim
