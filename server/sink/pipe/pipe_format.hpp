// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/jpeg.hpp"

namespace orbbuf {

/// What a frame looks like in a pipe; orbbuf/pipe.h reads both. Each image tells these lines:
///
///   seq=41
///   t=1.640000000      seconds, nine decimals
///   camera=left        or right; of stereo frames only, left image first
///   quality=30         of the JPEG, 1 to 100; absent if it is not known
///   whole=40123        bytes of the JPEG that the robot reduced this one from, of stereo frames of
///                      both together; absent: none, or not known
///   missed=12          frames of the session, since the last one in this pipe; absent: none
///   age=0.061          seconds from capture to here, by the clocks of robot and server; absent
///                      if that is a day or more, as of a replay with the times of its recording
///   session=ID
///   imu0=TIME,WX,WY,WZ,AX,AY,AZ   a sample of the sensor imu0, as parse_euroc_line() reads it:
///                      those since the last frame in this pipe, up to this one, in order; of
///                      stereo frames the left image has them
enum class PipeFormat : std::uint8_t {
  kPgm,    ///< binary P5 after binary P5, each line a comment of its own, after "# "
  kMjpeg,  ///< JPEG after JPEG, the lines in comment segments (COM) right after the first marker
};

/// What an image in a pipe tells beside its frame.
struct PipeNote {
  std::string session;
  std::uint64_t missed = 0;
  std::optional<std::chrono::nanoseconds> age;
  std::vector<std::string> samples{};  ///< such lines, with their ends
};

/// Decodes: 2 to 3 ms for 1241x376, twice that for a pair. An error if an image does not.
Result<std::vector<std::uint8_t>> to_pgm(const EncodedFrame& frame, const PipeNote& note,
                                         JpegCodec& codec);

/// Copies; zeros that a camera left behind an image are dropped. An error if an image does not
/// begin and end as a JPEG does, since a reader could not tell where the next one begins.
Result<std::vector<std::uint8_t>> to_mjpeg(const EncodedFrame& frame, const PipeNote& note);

}  // namespace orbbuf
