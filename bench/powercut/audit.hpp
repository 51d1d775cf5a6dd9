// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>

#include "bench/powercut/robot.hpp"

namespace orbbuf::powercut {

/// Of all sessions. `frames` to `messages` were found at the end, each once.
struct Counts {
  std::uint64_t cuts = 0;
  std::uint64_t frames = 0;
  std::uint64_t stereo = 0;   // of these
  std::uint64_t reduced = 0;  // of these, that came so and are whole now
  std::uint64_t late = 0;     // of these, that had been dropped
  std::uint64_t dropped = 0;
  std::uint64_t samples = 0;
  std::uint64_t messages = 0;
  std::uint64_t late_items = 0;  // records of samples or messages, of these
  std::uint64_t acknowledged = 0;
  std::uint64_t acknowledged_lost = 0;
  std::uint64_t old_lost = 0;  // of these, acknowledged some time before the cut
  std::uint64_t named_but_bad = 0;
  std::uint64_t repeated = 0;
  std::uint64_t unexplained = 0;
};

/// What is wrong in the session's folder, all that the robot had being delivered. What is missing
/// of what was late is lost if it was acknowledged, and else unexplained.
void audit(const Robot& robot, const std::filesystem::path& folder,
           const wire::Position& acknowledged, const wire::Position& old, Counts& counts);

/// What is wrong in the parts of the session's MCAP recording: they have each frame, drop record,
/// sample and message once; all of them if `is_whole`.
void audit_recording(const Robot& robot, const std::filesystem::path& folder, bool is_whole,
                     Counts& counts);

}  // namespace orbbuf::powercut
