// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/make_policy.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "daemon/buffer/orb_policy.hpp"
#include "daemon/buffer/simple_policies.hpp"

namespace orbbuf {

std::unique_ptr<DropPolicy> make_policy(const BufferSettings& settings, FillFeatures extract) {
  const std::string& name = settings.policy;
  if (name == "orbbuf") return std::make_unique<OrbPolicy>(std::move(extract));
  if (name == "uniform" || name == "catch-up") return std::make_unique<UniformPolicy>();
  if (name == "drop-oldest") return std::make_unique<DropOldestPolicy>();
  if (name == "drop-youngest") return std::make_unique<DropYoungestPolicy>();
  if (name == "random") return std::make_unique<RandomPolicy>(settings.seed);
  throw std::invalid_argument("unknown drop policy '" + name + "'");
}

FrameBuffer make_buffer(const BufferSettings& settings, FillFeatures extract) {
  auto policy = make_policy(settings, std::move(extract));
  // Where a size has 32 bits, more than it holds is no limit.
  const auto bytes =
      static_cast<std::size_t>(std::min<std::uint64_t>(settings.memory_bytes, SIZE_MAX));
  if (settings.policy != "catch-up")
    return {{settings.capacity, bytes, settings.is_waited_for}, std::move(policy)};
  return {{.bytes = bytes}, std::move(policy), std::make_unique<SendPlanner>(settings.plan)};
}

}  // namespace orbbuf
