// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <istream>
#include <optional>
#include <vector>

#include "bench/paper/camera.hpp"
#include "bench/paper/judge/odometry.hpp"

namespace orbbuf::paper {

/// Which frames a folder has: orbbuf-world's, or a session's as orbbuf-server writes it.
struct ListedFrame {
  std::uint64_t id = 0;
  double time_s = 0;
};

/// Reads times.txt. Throws std::runtime_error.
std::vector<ListedFrame> list_frames(const std::filesystem::path& folder);

/// Reads images/ID.jpg and, if asked for, images_right/ID.jpg. Throws std::runtime_error.
/// Reentrant.
JudgedFrame load_frame(const std::filesystem::path& folder, const ListedFrame& frame,
                       bool with_right);

/// The next frame of orbbuf-server's pipe (format "pgm"); nothing at its end. Throws
/// std::runtime_error if it is anything else, or ends within a frame.
std::optional<JudgedFrame> read_pipe(std::istream& in, bool is_stereo);

}  // namespace orbbuf::paper
