// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/size_model.hpp"

#include <algorithm>
#include <cmath>

namespace orbbuf {
namespace {

constexpr double kWeightOfSeen = 0.1;
constexpr double kLeastExponent =
    0.2;  // a result beyond these is an odd image, such as a black one
constexpr double kMostExponent = 1.0;
constexpr double kLeastRatio = 1.2;  // of the steps: closer ones say little of the exponent

/// The step of libjpeg's quantisation tables at `quality`, as a multiple of that at 50. Those at
/// 100 have steps of 1, about 1/30.
double step_at(int quality) {
  if (quality < 50) return 50.0 / quality;
  return std::max(2.0 - quality / 50.0, 1.0 / 30);
}

}  // namespace

double SizeModel::share(int quality) const { return std::pow(step_at(quality), -exponent_); }

void SizeModel::learn(double bytes, int from, double reduced_bytes, int to) {
  const double ratio = step_at(to) / step_at(from);
  if (ratio < kLeastRatio || bytes <= 0 || reduced_bytes <= 0) return;
  const double seen = std::log(bytes / reduced_bytes) / std::log(ratio);
  exponent_ += kWeightOfSeen * (std::clamp(seen, kLeastExponent, kMostExponent) - exponent_);
}

}  // namespace orbbuf
