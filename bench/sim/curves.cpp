// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/curves.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <utility>

namespace orbbuf::sim {
namespace {

constexpr std::size_t kFarthest = 45;

/// Long sequences are sampled: about a hundred pairs at each distance will do.
std::size_t stride(const RecordedSequence& sequence) {
  return std::max<std::size_t>(1, sequence.size() / 100);
}

/// Ranks from 0; equal values share the mean of theirs.
std::vector<double> ranks(const std::vector<int>& values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), 0U);
  std::ranges::sort(order, {}, [&](std::size_t i) { return values[i]; });
  std::vector<double> rank(values.size());
  for (std::size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    while (end < order.size() && values[order[end]] == values[order[begin]]) ++end;
    for (std::size_t i = begin; i < end; ++i) {
      rank[order[i]] = static_cast<double>(begin + end - 1) / 2;
    }
  }
  return rank;
}

}  // namespace

std::vector<DistancePoint> distance_curve(RecordedSequence& sequence) {
  const double self = sequence.self_similarity();
  std::vector<DistancePoint> curve;
  const std::size_t step = stride(sequence);
  for (std::size_t distance = 1; distance <= kFarthest && distance < sequence.size(); ++distance) {
    std::vector<double> shares;
    double inliers = 0;
    for (std::size_t i = 0; i + distance < sequence.size(); i += step) {
      shares.push_back(sequence.similarity(i, i + distance) / self);
      inliers += sequence.epipolar_inliers(i, i + distance);
    }
    std::ranges::sort(shares);
    const std::size_t count = shares.size();
    curve.push_back({distance, shares[count / 20], shares[count / 2],
                     shares[count - 1 - count / 20], inliers / static_cast<double>(count)});
  }
  return curve;
}

std::vector<double> noise_floor(const Rule& rule, const Sequences& sequences, std::size_t count,
                                std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<double> shares;
  while (shares.size() < count) {
    const RecordedSequence& one = *sequences[random() % sequences.size()];
    const RecordedSequence& other = *sequences[random() % sequences.size()];
    const FeatureSet& a = one.features(random() % one.size());
    const FeatureSet& b = other.features(random() % other.size());
    if (&one == &other) continue;
    const std::size_t poorer = std::min(a.descriptors.size(), b.descriptors.size());
    shares.push_back(static_cast<double>(count_matches(a, b, rule.match)) /
                     static_cast<double>(std::max<std::size_t>(1, poorer)));
  }
  std::ranges::sort(shares);
  return shares;
}

std::vector<double> neighbours(const Rule& rule, const RecordedSequence& sequence) {
  std::vector<double> shares;
  for (std::size_t i = 0; i + 1 < sequence.size(); ++i) {
    const FeatureSet& a = sequence.features(i);
    shares.push_back(static_cast<double>(count_matches(a, sequence.features(i + 1), rule.match)) /
                     static_cast<double>(std::max<std::size_t>(1, a.descriptors.size())));
  }
  std::ranges::sort(shares);
  return shares;
}

double rank_correlation(const Rule& rule, RecordedSequence& sequence) {
  std::vector<int> similarities;
  std::vector<int> inliers;
  for (std::size_t i = 0; i < sequence.size(); i += stride(sequence)) {
    for (std::size_t j = i + 1; j < sequence.size() && j <= i + kFarthest; ++j) {
      similarities.push_back(count_matches(sequence.features(i), sequence.features(j), rule.match));
      inliers.push_back(sequence.epipolar_inliers(i, j));
    }
  }
  const std::vector<double> x = ranks(similarities);
  const std::vector<double> y = ranks(inliers);
  const double mean = static_cast<double>(x.size() - 1) / 2;
  double xy = 0;
  double xx = 0;
  double yy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xy += (x[i] - mean) * (y[i] - mean);
    xx += (x[i] - mean) * (x[i] - mean);
    yy += (y[i] - mean) * (y[i] - mean);
  }
  return xy / std::sqrt(xx * yy);
}

}  // namespace orbbuf::sim
