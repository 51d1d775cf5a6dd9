// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <orbbuf/pipe.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <vector>

#include "evaluation/camera.hpp"
#include "evaluation/odometry/odometry.hpp"

namespace orbbuf::evaluation {

/// Which frames a folder has: orbbuf-world's, or a session's as orbbuf-server writes it.
struct ListedFrame {
  std::uint64_t id = 0;
  double time_s = 0;
};

/// Reads times.txt. Throws std::runtime_error.
std::vector<ListedFrame> list_frames(const std::filesystem::path& folder);

/// Reads images/ID.jpg and, if asked for, images_right/ID.jpg. Throws std::runtime_error.
/// Reentrant.
GrayFrame load_frame(const std::filesystem::path& folder, const ListedFrame& frame,
                     bool with_right);

struct PipedFrame {
  std::uint64_t id = 0;  ///< its sequence number
  GrayFrame frame;
};

/// What orbbuf-server writes to a SLAM program.
class Pipe {
 public:
  /// `in` stays the caller's.
  explicit Pipe(std::FILE* in);
  ~Pipe();
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;

  /// The next frame; nothing at the end. Throws std::runtime_error if it is anything else, or ends
  /// within a frame.
  std::optional<PipedFrame> next(bool is_stereo);

 private:
  std::optional<orbbuf_image> next_image();

  orbbuf_reader reader_;
};

}  // namespace orbbuf::evaluation
