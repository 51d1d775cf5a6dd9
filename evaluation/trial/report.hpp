// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace orbbuf::evaluation {

/// Some of all, and the 95 % interval of the share that they stand for (Wilson).
struct Share {
  std::size_t some = 0;
  std::size_t all = 0;

  double value() const {
    return all == 0 ? 0 : static_cast<double>(some) / static_cast<double>(all);
  }
  std::pair<double, double> interval() const;
};

/// "95 % (84 to 99)".
std::string to_text(const Share& share);

/// The median of values and its 95 % interval, from their order alone.
struct Median {
  double low = 0;
  double middle = 0;  ///< of an even number the larger of the two in the middle
  double high = 0;
};

/// With fewer than 6 values the interval has all of them.
Median median_of(std::vector<double> values);

/// "1.07"; "lost" if it is infinite.
std::string ratio_text(double ratio);

/// Writes a whole file. Throws std::runtime_error.
void write_text(const std::filesystem::path& file, const std::string& text);

}  // namespace orbbuf::evaluation
