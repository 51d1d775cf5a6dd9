// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "common/drop_record.hpp"
#include "common/error.hpp"

namespace orbbuf {

/// What a check of a session found. As long as there is no problem,
/// captured = live + late + on_robot + dropped, from where the folder's part of the session begins.
struct SessionReport {
  std::uint64_t captured = 0;
  std::uint64_t live = 0;
  std::uint64_t late = 0;      ///< passed over live, and arrived later
  std::uint64_t on_robot = 0;  ///< what the robot still has, as it last said
  bool is_open = false;        ///< the robot's live stream goes on
  std::uint64_t dropped = 0;   ///< named, and neither here nor on the robot
  /// Of those that are named: also of the ones that are still on the robot.
  std::map<DropReason, std::uint64_t> reasons;
  std::uint64_t image_bytes = 0;
  std::vector<std::string> problems;  ///< one line each
  std::vector<std::string> notes;     ///< the same, of what is no problem
};

/// In one line:
/// `OK: 510 captured: 460 live, 40 late, 7 on the robot, 3 dropped (2 policy, 1 busy); 12.3 MiB of
/// images`, `open: ...`, `2 problems: ...`. The reasons only if nothing is on the robot.
std::string summary(const SessionReport& report);

/// Compares a session's journal with what is in its folder: each frame's images there and as they
/// were received, nothing else among the images, the capture times in order, every number delivered
/// or named, the calibration as DSO reads it, the journal without damage, and the session ended by
/// the robot. The text files are not looked at: make_views() makes them again.
///
/// is_open: a server has the session open. That it has not ended is no problem then. What comes
/// meanwhile is not looked at.
///
/// An error if `folder` is no session or cannot be read. Reads every image. Memory: a few bits a
/// frame. Blocking, with its progress on stderr; reentrant.
Result<SessionReport> check_session(const std::filesystem::path& folder, bool is_open = false);

}  // namespace orbbuf
