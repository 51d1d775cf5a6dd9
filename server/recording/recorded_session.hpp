// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/drop_record.hpp"
#include "common/error.hpp"
#include "common/frame.hpp"
#include "server/recording/robot_holds.hpp"
#include "server/recording/segment_info.hpp"
#include "server/recording/sequence_set.hpp"
#include "server/recording/session_closing.hpp"
#include "server/recording/session_lines.hpp"

namespace orbbuf {

/// One line of times.txt, or of late.csv until the frame is merged.
struct RecordedFrame {
  Sequence sequence = 0;
  std::int64_t capture_time_ns = 0;
  std::string exposure_ms;       ///< as it is written there
  bool is_left_in_late = false;  ///< the image is not where it belongs yet, but in late/
  bool is_right_in_late = false;
};

/// Where a frame's image is, in the session's folder.
std::string left_image(const RecordedFrame& frame);
std::string right_image(const RecordedFrame& frame);

/// What the text files in a session's folder say (SessionFiles writes them; session_files.hpp has
/// the form). No image is opened.
struct RecordedSession {
  std::filesystem::path folder;
  /// In the order of the lines; late frames that are not merged are between them, by their numbers.
  std::vector<RecordedFrame> frames;
  /// In the order of the lines; the reason of late frames is kLate, merged or not.
  std::vector<DropRecord> drops;
  SequenceSet late;                 ///< the numbers that did not come live
  std::optional<RobotHolds> holds;  ///< nothing: the robot has never held any of it
  bool is_stereo = false;
  SegmentInfo segment;  ///< the first: the folder has the session from its beginning on
  std::optional<SessionClosing> closing;  ///< nothing: an older server has recorded it
  std::string calibration;                ///< of camera.txt; empty: there is none
  /// By the image's path in the folder; empty if the session was recorded without.
  std::map<std::string, std::uint32_t> checksums;
  /// Of the frames of which they are known.
  std::map<Sequence, session_lines::Quality> qualities;
  /// Lines that cannot be read, a torn last one among them; such are in none of the above.
  std::vector<std::string> problems;
};

/// An error if `folder` is not a session's: it has neither times.txt nor drops.csv nor late.csv, or
/// one of the files cannot be read. Reads all of them. Blocking; reentrant.
Result<RecordedSession> read_recorded_session(const std::filesystem::path& folder);

/// The line of quality.csv of a frame, with its end; empty if it has none.
std::string quality_line(const RecordedSession& session, Sequence sequence);

/// Frames whose number or time is not above that of the frame before them, one line each.
std::vector<std::string> problems_of_order(const RecordedSession& session);

}  // namespace orbbuf
