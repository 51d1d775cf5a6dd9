// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

namespace orbbuf {

/// The rates for which times in whole nanoseconds neither repeat nor, for years, overflow.
inline constexpr double kMinFps = 1e-3;
inline constexpr double kMaxFps = 1e6;

inline bool is_usable_fps(double fps) { return fps >= kMinFps && fps <= kMaxFps; }

/// When frame `index` of a stream of exactly `fps` frames per second is due, rounded to the
/// nanosecond from the start of the stream each time, so that no error adds up.
inline std::int64_t nominal_time_ns(std::int64_t index, double fps) {
  return std::llround(static_cast<double>(index) * 1e9 / fps);
}

}  // namespace orbbuf
