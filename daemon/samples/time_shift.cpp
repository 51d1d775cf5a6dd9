// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/time_shift.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace orbbuf {
namespace {

constexpr std::int64_t kStepNs = 1'000'000;
constexpr std::int64_t kMostNs = 200 * kStepNs;
constexpr std::size_t kLeastImages = 20;

/// How far the sensor has turned, at any time between its first and its last sample.
class Turned {
 public:
  explicit Turned(std::span<const Sample> samples) : samples_(samples), sums_(samples.size()) {
    for (std::size_t i = 1; i < samples.size(); ++i) {
      const double step_s = static_cast<double>(samples[i].time_ns - samples[i - 1].time_ns) * 1e-9;
      sums_[i] = sums_[i - 1] + step_s * (speed(samples[i - 1]) + speed(samples[i])) / 2;
    }
  }

  double at(std::int64_t time_ns) const {
    const auto after = std::ranges::upper_bound(samples_, time_ns, {}, &Sample::time_ns);
    if (after == samples_.end()) return sums_.back();
    const auto i = static_cast<std::size_t>(after - samples_.begin());
    const double share = static_cast<double>(time_ns - samples_[i - 1].time_ns) /
                         static_cast<double>(samples_[i].time_ns - samples_[i - 1].time_ns);
    return std::lerp(sums_[i - 1], sums_[i], share);
  }

 private:
  static double speed(const Sample& sample) {
    const auto& [x, y, z] = sample.angular_velocity;
    return std::hypot(x, y, z);
  }

  std::span<const Sample> samples_;
  std::vector<double> sums_;
};

/// Pearson's; 0 if one of them changes by less than 0.1 % of itself.
double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const auto mean = [](const std::vector<double>& values) {
    double sum = 0;
    for (const double value : values) sum += value;
    return sum / static_cast<double>(values.size());
  };
  const double mean_a = mean(a);
  const double mean_b = mean(b);
  double product = 0;
  double square_a = 0;
  double square_b = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    product += (a[i] - mean_a) * (b[i] - mean_b);
    square_a += (a[i] - mean_a) * (a[i] - mean_a);
    square_b += (b[i] - mean_b) * (b[i] - mean_b);
  }
  const double least = 1e-6 * static_cast<double>(a.size());
  const bool do_change = square_a > least * mean_a * mean_a && square_b > least * mean_b * mean_b;
  return do_change ? product / std::sqrt(square_a * square_b) : 0;
}

}  // namespace

std::optional<TimeShift> find_time_shift(std::span<const ImageMotion> motions,
                                         std::span<const Sample> samples) {
  if (samples.size() < 2) return std::nullopt;
  std::vector<ImageMotion> inside;
  std::ranges::copy_if(motions, std::back_inserter(inside), [&](const ImageMotion& motion) {
    return motion.from_ns - kMostNs >= samples.front().time_ns &&
           motion.to_ns + kMostNs <= samples.back().time_ns && motion.to_ns > motion.from_ns;
  });
  if (inside.size() < kLeastImages) return std::nullopt;
  const Turned turned(samples);
  std::vector<double> seen(inside.size());
  std::vector<double> felt(inside.size());
  const auto rate = [](const ImageMotion& motion, double way) {
    return way / static_cast<double>(motion.to_ns - motion.from_ns);
  };
  std::ranges::transform(inside, seen.begin(),
                         [&](const ImageMotion& each) { return rate(each, each.pixels); });
  TimeShift best;
  for (std::int64_t shift_ns = -kMostNs; shift_ns <= kMostNs; shift_ns += kStepNs) {
    std::ranges::transform(inside, felt.begin(), [&](const ImageMotion& each) {
      return rate(each, turned.at(each.to_ns + shift_ns) - turned.at(each.from_ns + shift_ns));
    });
    const double together = correlation(seen, felt);
    if (together > best.correlation) best = {static_cast<double>(shift_ns) * 1e-9, together};
  }
  if (best.correlation == 0 || std::llround(std::abs(best.seconds) * 1e9) == kMostNs) {
    return std::nullopt;  // at the border it may still rise
  }
  return best;
}

}  // namespace orbbuf
