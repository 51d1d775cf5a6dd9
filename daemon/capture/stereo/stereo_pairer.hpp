// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

enum class Side : std::uint8_t { kLeft, kRight };

/// Finds which frames of two cameras were captured together, by RawFrame::monotonic_ns. Frames of a
/// side come in the order of their times; the sides may be some frames ahead of each other. A frame
/// that can have no partner any more is given up and counted. Pure; reentrant.
class StereoPairer {
 public:
  /// What a side may be ahead of the other, in frames: the oldest beyond that is given up, so that
  /// a camera that is gone does not fill the memory.
  static constexpr std::size_t kMostWaiting = 4;

  /// tolerance: how far apart the images of a pair may be.
  explicit StereoPairer(std::chrono::nanoseconds tolerance) : tolerance_(tolerance) {}

  /// The pair that `frame` completes: the left frame, with the right one within it.
  std::optional<RawFrame> add(Side side, RawFrame frame);

  std::uint64_t pairs() const { return pairs_; }
  /// Given up; what still waits is not counted.
  std::uint64_t unpaired(Side side) const { return sides_.at(index(side)).unpaired; }
  std::chrono::nanoseconds tolerance() const { return tolerance_; }

 private:
  struct Waiting {
    std::deque<RawFrame> frames;  // of one side at most, by time
    std::uint64_t unpaired = 0;

    void give_up_first();
  };
  static std::size_t index(Side side) { return static_cast<std::size_t>(side); }

  const std::chrono::nanoseconds tolerance_;
  std::array<Waiting, 2> sides_;
  std::uint64_t pairs_ = 0;
};

}  // namespace orbbuf
