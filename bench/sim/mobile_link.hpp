// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace orbbuf::sim {

/// A recorded mobile link: how fast it was, stretch by stretch; begins again at its end.
struct RateTrace {
  struct Step {
    double duration_s = 0;
    double bytes_per_s = 0;
  };
  std::string name;
  std::vector<Step> steps;

  double duration_s() const;
  double mean_bytes_per_s() const;
};

/// Reads a log of the Ghent 4G data set (sabre's JSON) or, by the extension .up, a mahimahi trace,
/// in steps of half a second. Throws std::runtime_error.
RateTrace read_trace(const std::filesystem::path& file);

/// When the last of `bytes` has passed, if the first set out at `start_ns` and time 0 is `offset_s`
/// into the trace, whose rates are multiplied with `scale`.
std::int64_t finish(const RateTrace& trace, double scale, double offset_s, std::int64_t start_ns,
                    std::size_t bytes);

}  // namespace orbbuf::sim
