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
#include "server/recording/session_closing.hpp"

namespace orbbuf {

/// One line of times.txt.
struct RecordedFrame {
  Sequence sequence = 0;
  std::int64_t capture_time_ns = 0;
  std::string exposure_ms;  ///< as it is written there
};

/// What the text files in a session's folder say (SessionFiles writes them; session_files.hpp has
/// the form). No image is looked at.
struct RecordedSession {
  std::filesystem::path folder;
  std::vector<RecordedFrame> frames;  ///< in the order of the lines
  std::vector<DropRecord> drops;      ///< likewise
  bool is_stereo = false;
  std::optional<SessionClosing> closing;  ///< nothing: an older server has recorded it
  std::string calibration;                ///< of camera.txt; empty: there is none
  /// By the image's path in the folder; empty if the session was recorded without.
  std::map<std::string, std::uint32_t> checksums;
  /// Lines that cannot be read, a torn last one among them; such are in none of the above.
  std::vector<std::string> problems;
};

/// An error if `folder` is not a session's: it has neither times.txt nor drops.csv, or one of the
/// files cannot be read. Reads all of them. Blocking; reentrant.
Result<RecordedSession> read_recorded_session(const std::filesystem::path& folder);

/// Frames whose number or time is not above that of the frame before them, one line each.
std::vector<std::string> problems_of_order(const RecordedSession& session);

}  // namespace orbbuf
