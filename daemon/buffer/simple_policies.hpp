// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>

#include "daemon/buffer/drop_policy.hpp"

namespace orbbuf {

/// Gives up the oldest frame (paper, Sec. III-F). An outage costs one long run of frames.
class DropOldestPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& /*view*/) override { return 0; }
};

/// Gives up the frame before the newest (paper, Sec. III-F). An outage costs one long run, too.
class DropYoungestPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& view) override { return view.waiting.size() - 2; }
};

/// Gives up any frame but the newest, all equally likely (paper, Sec. III-F). A seed gives the same
/// choices on every platform.
class RandomPolicy final : public DropPolicy {
 public:
  explicit RandomPolicy(std::uint64_t seed) : random_(seed) {}

  /// std::uniform_int_distribution would choose differently from one standard library to the next.
  std::size_t victim(const BufferView& view) override {
    constexpr std::uint64_t kDraws = std::numeric_limits<std::uint64_t>::max();
    const std::uint64_t choices = view.waiting.size() - 1;
    const std::uint64_t limit = kDraws - kDraws % choices;  // so no remainder is favoured
    std::uint64_t drawn = random_();
    while (drawn >= limit) drawn = random_();
    return static_cast<std::size_t>(drawn % choices);
  }

 private:
  std::mt19937_64 random_;
};

/// Gives up the frame whose neighbours are closest in time, so that the remaining frames are evenly
/// spaced; the older of equals. Not in the paper; a stronger baseline than the paper's.
class UniformPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& view) override {
    std::size_t best = 0;
    for (std::size_t i = 1; i + 1 < view.waiting.size(); ++i) {
      if (view.gap_without(i) < view.gap_without(best)) best = i;
    }
    return best;
  }
};

}  // namespace orbbuf
