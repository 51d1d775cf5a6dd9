// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "daemon/buffer/drop_policy.hpp"
#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// `[buffer]` of orbbufd.toml.
struct BufferSettings {
  std::size_t capacity = 25;       ///< frames, >= 3: a frame needs two neighbours to be judged
  std::string policy = "orbbuf";   ///< one of kPolicies
  std::uint64_t seed = 1;          ///< of the random policy
  std::filesystem::path drop_log;  ///< the robot's own drop record; empty: none
};

/// Every drop policy, by its name in the configuration.
inline constexpr std::array<std::string_view, 5> kPolicies = {"orbbuf", "uniform", "drop-oldest",
                                                              "drop-youngest", "random"};

/// The policy that `settings.policy` names. `extract` is kept by those that look at images.
/// Throws std::invalid_argument for a name that is not in kPolicies.
std::unique_ptr<DropPolicy> make_policy(const BufferSettings& settings, FillFeatures extract);

}  // namespace orbbuf
