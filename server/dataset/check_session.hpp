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
  std::size_t dropped = 0;
  std::uint64_t image_bytes = 0;
  std::vector<std::string> problems;  ///< one line each
};

/// In one line: `OK: 500 frames, 3 dropped, 12.3 MiB of images`, `2 problems: ...`.
std::string summary(const SessionReport& report);

/// Compares a session's folder with what SessionFiles leaves there: every line whole and in order,
/// each frame's images there and as they were received, every number below the end delivered or
/// dropped and not both, nothing else among the images, camera.txt as DSO reads it, and the session
/// ended by the robot.
///
/// An image is compared with its checksum; where the session was recorded without, the JPEG is
/// decoded, which misses what still decodes. An error if `folder` is no session or cannot be read.
/// Reads every image. Blocking, with its progress on stderr; reentrant.
Result<SessionReport> check_session(const std::filesystem::path& folder);

}  // namespace orbbuf
