// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "bench/sim/link_model.hpp"
#include "common/frame.hpp"
#include "daemon/buffer/drop_policy.hpp"

namespace orbbuf::sim {

/// What a link and a policy made of a sequence. Frames are named by their index.
struct Delivery {
  std::vector<std::size_t> received;      ///< in order
  std::vector<std::size_t> drops_before;  ///< how many had been dropped when received[k] was taken
  std::vector<std::size_t> drops_after;   ///< how many, once frame T had been pushed
};

/// When the last of `bytes` has passed a link, if the first may set out at `start_ns`.
using FinishTime = std::function<std::int64_t(std::int64_t start_ns, std::size_t bytes)>;

/// Runs the daemon's own FrameBuffer on a virtual clock: every frame arrives at its capture time,
/// the link takes the oldest whenever the last one has passed, and `worker` has the time to prepare
/// between two arrivals. frames[i]->sequence must be i.
Delivery simulate(const std::vector<FramePtr>& frames, const LinkModel& link, std::size_t capacity,
                  std::unique_ptr<DropPolicy> policy);
/// The same over any link.
Delivery simulate(const std::vector<FramePtr>& frames, const FinishTime& finish,
                  std::size_t capacity, std::unique_ptr<DropPolicy> policy);

}  // namespace orbbuf::sim
