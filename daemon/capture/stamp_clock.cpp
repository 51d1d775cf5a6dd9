// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stamp_clock.hpp"

#include <algorithm>
#include <cstdlib>

#include "common/log.hpp"

namespace orbbuf {
namespace {

constexpr std::int64_t kEndOfStamps = std::int64_t{1} << 62;  // in 2116; sums of two stay in range
constexpr std::int64_t kJitterNs = StampClock::kJumpNs / 4;   // of the stamps behind a jump
constexpr std::int64_t kMemory = 8;                           // stamps

double seconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

}  // namespace

std::optional<std::int64_t> StampClock::fit(std::int64_t stamp_ns, std::int64_t arrival_ns) {
  if (stamp_ns > 0 && stamp_ns < kEndOfStamps) {
    const std::int64_t time_ns = stamp_ns - jumped_ns_;
    const std::int64_t delay_ns = arrival_ns - time_ns;
    expect_delay(delay_ns);
    // The delays of a backlog shrink, too, but its stamps follow each other.
    const bool is_next = last_ns_ != kNever && time_ns - last_ns_ < kJumpNs;
    if (time_ns > last_ns_ && (is_next || delay_ns >= *usual_delay_ns_ - kJumpNs)) {
      jump_.reset();
      learn(delay_ns, arrival_ns);
      return last_ns_ = time_ns;
    }
    if (has_jumped(delay_ns, arrival_ns)) {
      return last_ns_ = std::max(stamp_ns - jumped_ns_, last_ns_ + 1);
    }
  }
  note_misfit(stamp_ns, arrival_ns);
  return std::nullopt;
}

std::int64_t StampClock::time_of(std::int64_t stamp_ns, std::int64_t arrival_ns) {
  if (const auto time_ns = fit(stamp_ns, arrival_ns)) return *time_ns;
  return last_ns_ = std::max(arrival_ns - usual_delay_ns_.value_or(0), last_ns_ + 1);
}

/// Follows shorter delays soon, and longer ones by at most 1 % of the time: after a backlog, the
/// stamps fit as they did before it.
void StampClock::learn(std::int64_t delay_ns, std::int64_t arrival_ns) {
  const bool is_first = last_ns_ == kNever;
  const std::int64_t most_ns = is_first ? kJumpNs / 2 : (arrival_ns - last_arrival_ns_) / 100;
  *usual_delay_ns_ += std::min((delay_ns - *usual_delay_ns_) / (is_first ? 1 : kMemory), most_ns);
  last_arrival_ns_ = arrival_ns;
}

/// Before the first time there is nothing to go on with: the clock begins behind the jump. Stamps
/// that stand still never jump, since their delay grows.
bool StampClock::has_jumped(std::int64_t delay_ns, std::int64_t arrival_ns) {
  if (!jump_ || std::abs(delay_ns - jump_->delay_ns) > kJitterNs) jump_ = {arrival_ns, delay_ns, 0};
  jump_->delay_ns += (delay_ns - jump_->delay_ns) / ++jump_->count;
  if (arrival_ns - jump_->since_ns < kJumpNs) return false;
  if (last_ns_ == kNever) {
    usual_delay_ns_ = jump_->delay_ns;
  } else {
    const std::int64_t step_ns = *usual_delay_ns_ - jump_->delay_ns;
    jumped_ns_ += step_ns;
    log_warn("{}: the stamps have jumped by {:+.3f} s; its times go on without the jump", name_,
             seconds(step_ns));
  }
  jump_.reset();
  last_arrival_ns_ = arrival_ns;
  return true;
}

void StampClock::note_misfit(std::int64_t stamp_ns, std::int64_t arrival_ns) {
  if (++misfits_ > 1) return;
  log_warn(
      "{}: the stamp {} ns does not fit its arrival, expected was about {} ns: {}; others like "
      "it are counted, not logged",
      name_, stamp_ns, arrival_ns - usual_delay_ns_.value_or(0) + jumped_ns_, fate_);
}

}  // namespace orbbuf
