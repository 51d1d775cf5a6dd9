// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/backfill_pace.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace orbbuf {
namespace {

using Seconds = BackfillPace::Seconds;

constexpr double kPart = 1.0 / 16;      // of a new observation in the means
constexpr double kLongestInterval = 4;  // intervals that one observation counts for
constexpr Seconds kAheadOfFree{0.002};  // how far before the link is free to write
constexpr double kShortestGuard =
    1.0 / 10;  // of the interval: what is written may take longer than it should
constexpr Seconds kUnknownInterval{1};
constexpr Seconds kLongestTurn{0.25};  // without live frames

double or_unknown(double bytes_per_s) {
  return bytes_per_s > 0 ? bytes_per_s : BackfillPace::kUnknownRate;
}

BackfillPace::Time after(BackfillPace::Time time, Seconds later) {
  return time + std::chrono::duration_cast<BackfillPace::Clock::duration>(later);
}

}  // namespace

void BackfillPace::on_captured(Time now) {
  const Seconds since = now - std::exchange(captured_, now);
  if (!std::exchange(has_captured_, true)) return;
  if (interval_.count() <= 0) {
    interval_ = since;
    return;
  }
  const Seconds observed = std::min(since, kLongestInterval * interval_);
  deviation_ += kPart * (Seconds(std::abs((observed - interval_).count())) - deviation_);
  interval_ += kPart * (observed - interval_);
}

void BackfillPace::on_written(Time now, std::size_t bytes, double bytes_per_s) {
  const Seconds service(static_cast<double>(bytes) / or_unknown(bytes_per_s));
  busy_until_ = after(std::max(now, busy_until_), service);
}

BackfillPace::Turn BackfillPace::next(Time now, double bytes_per_s, Time busy_until) const {
  busy_until = std::max(busy_until, busy_until_);
  if (busy_until > after(now, kAheadOfFree)) return {0, busy_until};
  const Time free = std::max(now, busy_until);
  Seconds window = kLongestTurn;
  const Time late = after(captured_, 2 * interval_);  // none is expected any more
  const Time second = after(captured_, kUnknownInterval);
  if (has_captured_ && interval_.count() <= 0 && now < second) return {0, second};
  if (has_captured_ && now < late) {
    const Seconds guard = std::clamp(2 * deviation_, kShortestGuard * interval_, interval_ / 4);
    window = after(captured_, interval_ - guard) - free;
  }
  const double fits = window.count() * or_unknown(bytes_per_s);
  if (fits >= kLeastBytes)
    return {static_cast<std::size_t>(std::min<double>(fits, kMostBytes)), {}};
  return has_captured_ && now < late ? Turn{0, late} : Turn{kLeastBytes, {}};
}

}  // namespace orbbuf
