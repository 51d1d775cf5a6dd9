// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>

#include "daemon/buffer/drop_policy.hpp"

namespace orbbuf {

/// Keeps the newest frames (paper, Sec. III-F). An outage then costs one long run of frames.
class DropOldestPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& view) override;
};

/// Keeps the oldest frames and the newest one (paper, Sec. III-F): again one long run is lost.
class DropYoungestPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& view) override;
};

/// Any frame but the newest, all equally likely (paper, Sec. III-F). A seed gives the same choices
/// on every platform.
class RandomPolicy final : public DropPolicy {
 public:
  explicit RandomPolicy(std::uint64_t seed) : random_(seed) {}

  std::size_t victim(const BufferView& view) override;

 private:
  std::mt19937_64 random_;
};

/// The frame whose neighbours are closest in time, so that what remains is spaced evenly whatever
/// it shows; the older of equals. Not in the paper, and a stronger rival than those that are.
class UniformPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& view) override;
};

}  // namespace orbbuf
