// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/rate_meter.hpp"

#include <algorithm>
#include <cmath>

namespace orbbuf::sim {
namespace {

constexpr double kTimeConstantS = 1;
constexpr double kLongestOfPredicted = 4;

}  // namespace

void RateMeter::on_sent(std::size_t bytes, double seconds) {
  if (seconds <= 0) return;
  const auto size = static_cast<double>(bytes);
  if (seconds_ > 0) seconds = std::min(seconds, kLongestOfPredicted * size / bytes_per_s());
  const double kept = std::exp(-seconds / kTimeConstantS);
  bytes_ = kept * bytes_ + size;
  seconds_ = kept * seconds_ + seconds;
}

}  // namespace orbbuf::sim
