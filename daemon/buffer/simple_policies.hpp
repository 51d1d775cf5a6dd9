// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>

#include "daemon/buffer/drop_policy.hpp"

namespace orbbuf {

/// Gives up the oldest frame (paper, Sec. III-F). An outage costs one long run of frames.
class DropOldestPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& view) override;
};

/// Gives up the frame before the newest (paper, Sec. III-F). An outage costs one long run, too.
class DropYoungestPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& view) override;
};

/// Gives up any frame but the newest, all equally likely (paper, Sec. III-F). A seed gives the same
/// choices on every platform.
class RandomPolicy final : public DropPolicy {
 public:
  explicit RandomPolicy(std::uint64_t seed) : random_(seed) {}

  std::size_t victim(const BufferView& view) override;

 private:
  std::mt19937_64 random_;
};

/// Gives up the frame whose neighbours are closest in time, so that the remaining frames are evenly
/// spaced; the older of equals. Not in the paper; a stronger baseline than the paper's.
class UniformPolicy final : public DropPolicy {
 public:
  std::size_t victim(const BufferView& view) override;
};

}  // namespace orbbuf
