// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

/// What a check of a session found.
struct SessionReport {
  std::size_t frames = 0;
  std::size_t dropped = 0;     ///< named by drops.csv, and not there
  std::size_t late = 0;        ///< of the frames: passed over live, and arrived later
  std::uint64_t on_robot = 0;  ///< what the robot still has, as it last said
  std::uint64_t lost = 0;  ///< what is neither here nor there: captured = frames + on_robot + lost
  std::uint64_t image_bytes = 0;
  std::vector<std::string> problems;  ///< one line each
  std::vector<std::string> notes;     ///< the same, of what is no problem
};

/// In one line: `OK: 500 frames, 3 dropped, 12.3 MiB of images`, `2 problems: ...`. Where something
/// came late or is still to come:
/// `OK: 510 captured: 460 live, 40 late, 7 on the robot, 3 lost; 12.3 MiB of images`.
std::string summary(const SessionReport& report);

/// Compares a session's folder with what SessionFiles leaves there: every line whole and in order,
/// each frame's images there and as they were received, those of late frames in their folder or
/// merged, every number below the end delivered or dropped and not both unless it came late,
/// nothing else among the images, camera.txt as DSO reads it, and the session ended by the robot.
///
/// An image is compared with its checksum; where the session was recorded without, the JPEG is
/// decoded, which misses what still decodes. An error if `folder` is no session or cannot be read.
/// Reads every image. Blocking, with its progress on stderr; reentrant.
Result<SessionReport> check_session(const std::filesystem::path& folder);

}  // namespace orbbuf
