// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace orbbuf {

/// StampClock's `fate` for sources of images.
inline constexpr std::string_view kFateOfImages =
    "the image has the time of its arrival, less the usual delay";

/// Which stamps of a live source are its times: those that fit their arrival. The delay from stamp
/// to arrival says so. A stamp fits if it is after the time before, and its delay is at most
/// kJumpNs shorter than usual; a longer one only means that the reader was held up. Where stamps
/// jump and stay there for kJumpNs, the times go on without the jump from then on. Logs the first
/// misfit and each jump. Has no clock of its own; thread-bound.
class StampClock {
 public:
  static constexpr std::int64_t kJumpNs = 1'000'000'000;

  /// For the log: name: the source's; fate: what becomes of the item whose stamp does not fit.
  StampClock(std::string name, std::string_view fate) : name_(std::move(name)), fate_(fate) {}

  /// Without it, the first stamp fits.
  void expect_delay(std::int64_t delay_ns) {
    if (!usual_delay_ns_) usual_delay_ns_ = delay_ns;
  }

  /// For samples: the time, by the clock that the stamps began with; nothing: the stamp does not
  /// fit. Times strictly increase. arrival_ns: by a clock that is never set, and counts sleep.
  std::optional<std::int64_t> fit(std::int64_t stamp_ns, std::int64_t arrival_ns);
  /// For images: the arrival less the usual delay, if the stamp does not fit.
  std::int64_t time_of(std::int64_t stamp_ns, std::int64_t arrival_ns);

  /// What the stamps jumped by, in all: to be added to the times for the source's present clock.
  std::int64_t jumped_ns() const { return jumped_ns_; }
  std::uint64_t misfits() const { return misfits_; }

 private:
  struct Jump {
    std::int64_t since_ns = 0;
    std::int64_t delay_ns = 0;  // the mean
    std::int64_t count = 0;
  };

  void learn(std::int64_t delay_ns, std::int64_t arrival_ns);
  bool has_jumped(std::int64_t delay_ns, std::int64_t arrival_ns);
  void note_misfit(std::int64_t stamp_ns, std::int64_t arrival_ns);

  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::min();

  std::string name_;
  std::string_view fate_;
  std::optional<std::int64_t> usual_delay_ns_;  // with the jumps; of the quick ones
  std::int64_t jumped_ns_ = 0;
  std::int64_t last_ns_ = kNever;
  std::int64_t last_arrival_ns_ = 0;
  std::optional<Jump> jump_;  // stamps do not fit since then, in the same way
  std::uint64_t misfits_ = 0;
};

}  // namespace orbbuf
