// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/ideas.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

namespace orbbuf::sim {
namespace {

/// What a policy sees of the frame it might give up.
struct Candidate {
  double left;   ///< similarity to the frame before
  double right;  ///< to the frame after
  double score;  ///< of the two to each other
  double gap_s;  ///< the time between them
};

/// The larger the value, the sooner the frame goes. Gives up the head first if nothing is before
/// it.
class ValuePolicy final : public DropPolicy {
 public:
  using Value = std::function<double(const Candidate&)>;

  ValuePolicy(PairSimilarity similarity, Value value)
      : similarity_(std::move(similarity)), value_(std::move(value)) {}

  std::size_t victim(const BufferView& view) override {
    if (!view.previous) return 0;
    std::size_t best = 0;
    double best_value = -std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i + 1 < view.waiting.size(); ++i) {
      const Sequence left = view.left_of(i)->sequence;
      const Sequence frame = view.waiting[i]->sequence;
      const Sequence right = view.waiting[i + 1]->sequence;
      const double value = value_({static_cast<double>(similarity_(left, frame)),
                                   static_cast<double>(similarity_(frame, right)),
                                   static_cast<double>(similarity_(left, right)),
                                   static_cast<double>(view.gap_without(i)) * 1e-9});
      if (value > best_value) {
        best = i;
        best_value = value;
      }
    }
    return best;
  }

 private:
  PairSimilarity similarity_;
  Value value_;
};

double product_value(const Candidate& c) {
  return std::log1p(c.score) - std::log1p(c.left) - std::log1p(c.right);
}

double barrier_value(const Candidate& c) {
  const auto barrier = [](double similarity) { return std::pow(1 + similarity, -4); };
  return barrier(c.left) + barrier(c.right) - barrier(c.score);
}

double rate_value(const Candidate& c) { return (c.score + 5) / c.gap_s; }

class LiteralPolicy final : public DropPolicy {
 public:
  explicit LiteralPolicy(PairSimilarity similarity) : similarity_(std::move(similarity)) {}

  std::size_t victim(const BufferView& view) override {
    if (!view.previous) return 0;
    std::size_t best = 0;
    std::pair<int, int> best_value{-1, -1};
    for (std::size_t i = 0; i + 1 < view.waiting.size(); ++i) {
      const int score = similarity_(view.left_of(i)->sequence, view.waiting[i + 1]->sequence);
      const std::pair value{std::min(score, smallest_without(view, i)), score};
      if (value > best_value) {
        best = i;
        best_value = value;
      }
    }
    return best;
  }

 private:
  /// Of the pairs that waiting[i] has no part in.
  int smallest_without(const BufferView& view, std::size_t i) const {
    int smallest = std::numeric_limits<int>::max();
    for (std::size_t j = 0; j < view.waiting.size(); ++j) {
      if (j == i || j == i + 1) continue;
      smallest =
          std::min(smallest, similarity_(view.left_of(j)->sequence, view.waiting[j]->sequence));
    }
    return smallest;
  }

  PairSimilarity similarity_;
};

class PlanPolicy final : public DropPolicy {
 public:
  explicit PlanPolicy(PairSimilarity similarity) : similarity_(std::move(similarity)) {}

  std::size_t victim(const BufferView& view) override {
    if (!view.previous) return 0;
    const std::vector<bool> is_kept = plan(view);
    std::size_t best = 0;
    int best_score = -1;
    for (std::size_t i = 0; i + 1 < view.waiting.size(); ++i) {
      if (is_kept[i]) continue;
      const int score = similarity_(view.left_of(i)->sequence, view.waiting[i + 1]->sequence);
      if (score > best_score) {
        best = i;
        best_score = score;
      }
    }
    return best;
  }

 private:
  /// Which four fifths would be kept, the newest among them, for the largest smallest similarity.
  std::vector<bool> plan(const BufferView& view) const {
    // With nothing dropped but frames already gone, keeping k of the waiting frames from `previous`
    // on is choosing received[0..k] by the same rule as the fifo_oracle does.
    const std::size_t count = view.waiting.size() + 1;
    const std::size_t kept = count - std::max<std::size_t>(1, view.waiting.size() / 5);
    const std::size_t dropped = count - kept;
    Delivery goal;
    goal.drops_before.assign(kept, dropped);
    goal.drops_after.assign(count, 0);
    goal.received.resize(kept);
    goal.drops_before[0] = 0;  // received[0] is `previous`
    goal.drops_after.back() = dropped;
    const auto sequence_of = [&](std::size_t i) {
      return i == 0 ? view.previous->sequence : view.waiting[i - 1]->sequence;
    };
    std::vector<bool> is_kept(view.waiting.size(), false);
    for (const std::size_t i : fifo_oracle(goal, [&](std::size_t a, std::size_t b) {
           return similarity_(sequence_of(a), sequence_of(b));
         })) {
      if (i > 0) is_kept[i - 1] = true;
    }
    return is_kept;
  }

  PairSimilarity similarity_;
};

}  // namespace

std::unique_ptr<DropPolicy> make_idea(std::string_view name, PairSimilarity similarity) {
  const auto by_value = [&](ValuePolicy::Value value) {
    return std::make_unique<ValuePolicy>(std::move(similarity), std::move(value));
  };
  if (name == "product") return by_value(product_value);
  if (name == "barrier") return by_value(barrier_value);
  if (name == "rate") return by_value(rate_value);
  if (name == "eq3") return std::make_unique<LiteralPolicy>(std::move(similarity));
  if (name == "plan") return std::make_unique<PlanPolicy>(std::move(similarity));
  throw std::invalid_argument("no idea called '" + std::string(name) + "'");
}

}  // namespace orbbuf::sim
