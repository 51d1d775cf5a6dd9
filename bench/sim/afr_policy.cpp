// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/afr_policy.hpp"

#include <algorithm>

namespace orbbuf::sim {

bool AfrPolicy::admits(std::size_t waiting) {
  const std::size_t sent = left_behind_ - std::min(left_behind_, waiting);
  position_ -= std::min(position_, sent);
  if (level_ > 1 && 3 * waiting <= 2 * capacity_) {
    level_ /= 2;
    skipped_ %= level_;
  }
  const bool is_admitted = skipped_ + 1 == level_;
  skipped_ = is_admitted ? 0 : skipped_ + 1;
  left_behind_ = std::min(capacity_, waiting + (is_admitted ? 1 : 0));
  return is_admitted;
}

std::size_t AfrPolicy::victim(const BufferView& view) {
  const std::size_t victim = std::min(position_, view.waiting.size() - 2);
  if (++position_ >= capacity_) {
    position_ = 0;
    level_ *= 2;
  }
  return victim;
}

}  // namespace orbbuf::sim
