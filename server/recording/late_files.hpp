// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "server/recording/line_file.hpp"
#include "server/recording/robot_holds.hpp"
#include "server/recording/sequence_set.hpp"

namespace orbbuf {

/// The late frames of one session: those that its live stream passed over, and that come
/// afterwards, in any order, perhaps in a later session of the robot. They go to the session's
/// folder (SessionFiles), beside what the live stream has written there, until merge_late():
///
///   late/images/000123.jpg, late/images_right/000123.jpg   not in images/, of which dso_dataset
///                 opens every file
///   late.csv      `123,1.633012000,0.000000,8C4F21D3,,1763779406.123456789`: number, capture time,
///                 exposure, checksums of left and right image, when it came; a header first. It
///                 stays after the merge
///   spool.csv     what the robot still has of the session (RobotHolds)
///
/// The line in late.csv is what makes a late frame accepted, as that in times.txt does for one of
/// the live stream; GroupCommit brings it onto the device before it is acknowledged.
///
/// Blocking; reentrant, called by one thread at a time. Of a session there may be a SessionFiles,
/// in another thread, at the same time; not a second LateFiles, nor a merge_late().
class LateFiles {
 public:
  /// Touches nothing. The folder is made by the first frame, if the live stream has left none.
  explicit LateFiles(std::filesystem::path folder);

  /// False: the frame is there already, late or delivered live. On error nothing of the frame
  /// remains. The first call reads late.csv and times.txt, and compares the newest late images with
  /// their checksums (recover_late()).
  Result<bool> write(const EncodedFrame& frame, std::int64_t arrived_ns);

  /// Replaces spool.csv, if the count or the first number has changed. Of a session without a
  /// folder, and of one of which the robot has never held anything, nothing is kept.
  std::optional<Error> note(const RobotHolds& holds);

 private:
  std::optional<Error> open();
  Result<bool> is_delivered(const EncodedFrame& frame);
  std::optional<Error> write_images(const EncodedFrame& frame) const;

  const std::filesystem::path folder_;
  const std::filesystem::path temporary_;  // SessionFiles has one of its own
  LineFile list_;
  SequenceSet arrived_;
  SequenceSet delivered_;  // the numbers of times.txt when it had times_bytes_
  std::uintmax_t times_bytes_ = 0;
  bool is_open_ = false;
};

}  // namespace orbbuf
