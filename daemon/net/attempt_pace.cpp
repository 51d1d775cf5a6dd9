// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/attempt_pace.hpp"

#include <algorithm>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

constexpr int kPartOfOutage = 600;
constexpr AttemptPace::Duration kLongestInOutage = 1s;
constexpr AttemptPace::Duration kLongestRefused = 10s;

}  // namespace

AttemptPace::Duration AttemptPace::interval(Time now) const {
  return std::max({shortest_, 2 * round_trip_ / (at_once_ - 1),
                   std::min(outage(now) / kPartOfOutage, kLongestInOutage)});
}

AttemptPace::Duration AttemptPace::slowed(Duration interval) const {
  for (int i = 0; i < refusals_ && interval < kLongestRefused; ++i) interval *= 2;
  return refusals_ > 0 ? std::min(interval, kLongestRefused) : interval;
}

}  // namespace orbbuf
