// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/simple_policies.hpp"

#include <limits>

namespace orbbuf {
namespace {

constexpr std::uint64_t kDraws = std::numeric_limits<std::uint64_t>::max();

}  // namespace

std::size_t DropOldestPolicy::victim(const BufferView& /*view*/) { return 0; }

std::size_t DropYoungestPolicy::victim(const BufferView& view) { return view.waiting.size() - 2; }

// std::uniform_int_distribution would choose differently from one standard library to the next.
std::size_t RandomPolicy::victim(const BufferView& view) {
  const std::uint64_t choices = view.waiting.size() - 1;
  const std::uint64_t limit = kDraws - kDraws % choices;  // so no remainder is favoured
  std::uint64_t drawn = random_();
  while (drawn >= limit) drawn = random_();
  return static_cast<std::size_t>(drawn % choices);
}

std::size_t UniformPolicy::victim(const BufferView& view) {
  std::size_t best = 0;
  for (std::size_t i = 1; i + 1 < view.waiting.size(); ++i) {
    if (view.gap_without(i) < view.gap_without(best)) best = i;
  }
  return best;
}

}  // namespace orbbuf
