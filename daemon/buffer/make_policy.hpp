// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "daemon/buffer/drop_policy.hpp"
#include "daemon/buffer/features.hpp"
#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/buffer/send_planner.hpp"

namespace orbbuf {

/// `[buffer]` of orbbufd.toml.
struct BufferSettings {
  std::string policy = "catch-up";         ///< one of kPolicies
  std::size_t capacity = 25;               ///< frames, >= 3; of all policies but catch-up
  std::uint64_t memory_bytes = 64U << 20;  ///< of JPEG, that may wait
  bool is_waited_for = false;              ///< see BufferLimits
  PlanSettings plan;                       ///< of catch-up; `[link]` of orbbufd.toml
  std::uint64_t seed = 1;                  ///< of the random policy
};

/// Every drop policy, by its name in the configuration.
inline constexpr std::array<std::string_view, 6> kPolicies = {
    "catch-up", "orbbuf", "uniform", "drop-oldest", "drop-youngest", "random"};

/// The policy that `settings.policy` names; for `catch-up`, the policy of its full buffer, which is
/// `uniform`. A policy that compares images keeps `extract`. Throws std::invalid_argument for a
/// name that is not in kPolicies.
std::unique_ptr<DropPolicy> make_policy(const BufferSettings& settings, FillFeatures extract);

/// The buffer with that policy: under `catch-up` bounded by bytes, and with a planner; else bounded
/// by frames and bytes. Throws as make_policy() and FrameBuffer do.
FrameBuffer make_buffer(const BufferSettings& settings, FillFeatures extract);

}  // namespace orbbuf
