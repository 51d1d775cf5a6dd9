// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/oracle.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "bench/sim/link_model.hpp"
#include "daemon/buffer/simple_policies.hpp"

namespace orbbuf::sim {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr double kInfinite = std::numeric_limits<double>::infinity();

std::vector<FramePtr> random_frames(std::mt19937& random, std::size_t count) {
  std::vector<FramePtr> frames;
  std::int64_t time_ns = 0;
  for (std::size_t i = 0; i < count; ++i) {
    EncodedFrame frame;
    frame.sequence = i;
    frame.capture_time_ns = time_ns;
    frame.jpeg.assign(500 + random() % 1000, 0);
    frames.push_back(std::make_shared<const EncodedFrame>(std::move(frame)));
    time_ns += static_cast<std::int64_t>(50 + random() % 100) * kMs;
  }
  return frames;
}

/// Tries whatever may be done whenever the link is free: send any captured frame that is newer than
/// the last, or wait for the next capture.
class EveryChoice {
 public:
  EveryChoice(const OracleProblem& problem, const StepCost& cost) : problem_(problem), cost_(cost) {
    go_on(problem.last, problem.finish(problem.last_begin_ns, bytes(problem.last)), -kInfinite);
  }

  /// Infinite: none is live in time.
  double best() const { return best_; }

 private:
  std::size_t bytes(std::size_t i) const { return problem_.frames[i]->jpeg.size(); }
  std::int64_t capture_ns(std::size_t i) const { return problem_.frames[i]->capture_time_ns; }

  void go_on(std::size_t last, std::int64_t now_ns, double largest) {
    if (now_ns > problem_.deadline_ns) return;
    const std::size_t count = problem_.frames.size();
    std::size_t next = last + 1;
    for (; next < count && capture_ns(next) <= now_ns; ++next) {
      const double cost = std::max(largest, cost_(last, next));
      if (next + 1 == count || capture_ns(next + 1) >= now_ns) best_ = std::min(best_, cost);
      go_on(next, problem_.finish(now_ns, bytes(next)), cost);
    }
    if (next < count) go_on(last, capture_ns(next), largest);
  }

  const OracleProblem& problem_;
  const StepCost& cost_;
  double best_ = kInfinite;
};

struct Case {
  std::vector<FramePtr> frames;
  LinkModel link;
  OracleProblem problem;
};

/// Ten frames; the link dies while the first is on its way.
Case random_case(std::mt19937& random) {
  Case made;
  made.frames = random_frames(random, 10);
  made.link = {10'000 + static_cast<double>(random() % 10'000), 10 * kMs,
               static_cast<std::int64_t>(200 + random() % 400) * kMs};
  const LinkModel link = made.link;
  made.problem.finish = [link](std::int64_t start_ns, std::size_t bytes) {
    return link.finish(start_ns, bytes);
  };
  made.problem.deadline_ns = link.outage_end_ns + static_cast<std::int64_t>(random() % 500) * kMs;
  return made;
}

void expect_best(const OracleProblem& problem, const StepCost& cost, bool is_monotone) {
  const EveryChoice every(problem, cost);
  const auto path = oracle(problem, cost, is_monotone, 1e-9);
  ASSERT_EQ(path.has_value(), every.best() < kInfinite);
  if (!path) return;
  EXPECT_NEAR(path->largest_cost, every.best(), 1e-9);
  double largest = -kInfinite;
  std::size_t last = problem.last;
  for (const std::size_t frame : path->frames) {
    ASSERT_GT(frame, last);
    largest = std::max(largest, cost(last, frame));
    last = frame;
  }
  EXPECT_DOUBLE_EQ(largest, path->largest_cost);
}

TEST(Oracle, FindsTheSmallestStepOnAClock) {
  std::mt19937 random(1);
  for (int round = 0; round < 300; ++round) {
    Case made = random_case(random);
    made.problem.frames = made.frames;
    const StepCost cost = [&](std::size_t i, std::size_t j) {
      return 1e-9 *
             static_cast<double>(made.frames[j]->capture_time_ns - made.frames[i]->capture_time_ns);
    };
    expect_best(made.problem, cost, true);
    expect_best(made.problem, cost, false);
  }
}

TEST(Oracle, FindsTheSmallestStepOfAnyCost) {
  std::mt19937 random(2);
  for (int round = 0; round < 300; ++round) {
    Case made = random_case(random);
    made.problem.frames = made.frames;
    std::vector<std::vector<double>> table(10, std::vector<double>(10));
    for (auto& row : table) {
      for (double& value : row) value = -static_cast<double>(random() % 30);
    }
    expect_best(
        made.problem, [&](std::size_t i, std::size_t j) { return table[i][j]; }, false);
  }
}

/// The same with a choice of quality at each send: the smallest largest step, and then the highest
/// lowest quality.
class EveryQuality {
 public:
  EveryQuality(const OracleProblem& problem, const StepCost& cost, const BytesAt& bytes_at,
               std::span<const int> qualities)
      : problem_(problem), cost_(cost), bytes_at_(bytes_at), qualities_(qualities) {
    const std::size_t bytes = problem.frames[problem.last]->jpeg.size();
    go_on(problem.last, problem.finish(problem.last_begin_ns, bytes), {-kInfinite, -100});
  }

  /// The cost, and the quality with a minus. Infinite: none is live in time.
  std::pair<double, int> best() const { return best_; }

 private:
  std::int64_t capture_ns(std::size_t i) const { return problem_.frames[i]->capture_time_ns; }

  void go_on(std::size_t last, std::int64_t now_ns, std::pair<double, int> so_far) {
    if (now_ns > problem_.deadline_ns) return;
    const std::size_t count = problem_.frames.size();
    std::size_t next = last + 1;
    for (; next < count && capture_ns(next) <= now_ns; ++next) {
      for (const int quality : qualities_) {
        const std::pair worse(std::max(so_far.first, cost_(last, next)),
                              std::max(so_far.second, -quality));
        if (next + 1 == count || capture_ns(next + 1) >= now_ns) best_ = std::min(best_, worse);
        go_on(next, problem_.finish(now_ns, bytes_at_(next, quality)), worse);
      }
    }
    if (next < count) go_on(last, capture_ns(next), so_far);
  }

  const OracleProblem& problem_;
  const StepCost& cost_;
  const BytesAt& bytes_at_;
  const std::span<const int> qualities_;
  std::pair<double, int> best_{kInfinite, 0};
};

TEST(Oracle, FindsTheSmallestStepAndThenTheHighestQuality) {
  constexpr std::array<int, 3> kQualities = {80, 40, 20};
  std::mt19937 random(5);
  int reduced = 0;
  for (int round = 0; round < 200; ++round) {
    Case made = random_case(random);
    made.frames.resize(6);
    made.problem.frames = made.frames;
    const BytesAt bytes_at = [&](std::size_t i, int quality) {
      return made.frames[i]->jpeg.size() * static_cast<std::size_t>(quality) / 80;
    };
    const StepCost cost = [&](std::size_t i, std::size_t j) {
      return 1e-9 *
             static_cast<double>(made.frames[j]->capture_time_ns - made.frames[i]->capture_time_ns);
    };
    const auto [step, quality] = EveryQuality(made.problem, cost, bytes_at, kQualities).best();
    const auto found = oracle(made.problem, bytes_at, kQualities, cost, true, 1e-9);
    ASSERT_EQ(found.has_value(), step < kInfinite) << round;
    if (!found) continue;
    EXPECT_NEAR(found->path.largest_cost, step, 1e-9) << round;
    EXPECT_EQ(found->quality, -quality) << round;
    if (found->quality < 80) ++reduced;
  }
  EXPECT_GT(reduced, 20);  // else nothing was tried
}

TEST(Oracle, BoundsAPolicyThatDropsAtTheSameLateness) {
  std::mt19937 random(3);
  for (int round = 0; round < 100; ++round) {
    Case made = random_case(random);
    made.problem.frames = made.frames;
    const Delivery delivery =
        simulate(made.frames, made.link, {{.frames = 3}, std::make_unique<UniformPolicy>()});
    double largest = 0;
    std::size_t k = 1;
    for (; k < delivery.received.size(); ++k) {
      const std::size_t i = delivery.received[k];
      largest = std::max(largest, static_cast<double>(i - delivery.received[k - 1]));
      if (i + 1 == made.frames.size() ||
          made.frames[i + 1]->capture_time_ns >= delivery.begin_ns[k]) {
        break;
      }
    }
    ASSERT_LT(k, delivery.received.size());
    made.problem.deadline_ns = delivery.begin_ns[k];
    const auto path = oracle(
        made.problem, [](std::size_t i, std::size_t j) { return static_cast<double>(j - i); }, true,
        0.5);
    ASSERT_TRUE(path) << "round " << round;
    EXPECT_LE(path->largest_cost, largest) << "round " << round;
  }
}

TEST(Oracle, HasNothingWhereTheDeadlineIsOver) {
  std::mt19937 random(4);
  Case made = random_case(random);
  made.problem.frames = made.frames;
  made.problem.deadline_ns = made.link.outage_end_ns;
  EXPECT_FALSE(oracle(
      made.problem, [](std::size_t, std::size_t) { return 0.0; }, true, 1));
}

}  // namespace
}  // namespace orbbuf::sim
