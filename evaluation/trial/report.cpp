// SPDX-License-Identifier: Apache-2.0
#include "evaluation/trial/report.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <vector>

namespace orbbuf::evaluation {

std::pair<double, double> Share::interval() const {
  if (all == 0) return {0, 1};
  constexpr double kZ = 1.959964;  // of 95 %
  const auto n = static_cast<double>(all);
  const double middle = (value() + kZ * kZ / (2 * n)) / (1 + kZ * kZ / n);
  const double half =
      kZ / (1 + kZ * kZ / n) * std::sqrt(value() * (1 - value()) / n + kZ * kZ / (4 * n * n));
  return {std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

std::string to_text(const Share& share) {
  const auto [low, high] = share.interval();
  return fmt::format("{:.0f} % ({:.0f} to {:.0f})", 100 * share.value(), 100 * low, 100 * high);
}

Median median_of(std::vector<double> values) {
  if (values.empty()) return {};
  constexpr double kTail = 0.025;
  std::ranges::sort(values);
  const std::size_t n = values.size();
  // The number of values below the true median is that of heads in n throws of a coin: fewer than
  // `rank` of them with a probability of at most kTail.
  std::size_t rank = 0;
  double cumulative = std::pow(0.5, n);
  for (double term = cumulative; cumulative <= kTail; ++rank, cumulative += term) {
    term *= static_cast<double>(n - rank) / static_cast<double>(rank + 1);
  }
  const std::size_t outside = rank == 0 ? 0 : rank - 1;
  return {values[outside], values[n / 2], values[n - 1 - outside]};
}

std::string ratio_text(double ratio) {
  return std::isinf(ratio) ? "lost" : fmt::format("{:.2f}", ratio);
}

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

}  // namespace orbbuf::evaluation
