// SPDX-License-Identifier: Apache-2.0
#pragma once

/// What the controller and the preloaded library agree on.
namespace orbbuf::simulation {

inline constexpr const char* kZygoteVariable = "ORBBUF_SIMULATION";
inline constexpr int kWorldDescriptor = 200;
inline constexpr int kZygoteDescriptor = 201;
inline constexpr int kTraceDescriptor = 202;

}  // namespace orbbuf::simulation
