// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "common/frame.hpp"

namespace orbbuf::bench {

/// What became of one captured frame.
struct FrameOutcome {
  Sequence sequence = 0;
  double capture_time_s = 0;  ///< since the first
  bool is_delivered = false;
  int similarity = -1;  ///< M to the delivered frame before it; -1: there is none, or not delivered
};

/// What became of every captured frame of a session, by its folder.
struct SessionOutcome {
  std::string label;
  std::vector<FrameOutcome> frames;  ///< by sequence

  std::size_t delivered() const;
  std::size_t dropped() const;
  /// Most captured frames in a row that are missing between two delivered ones.
  std::size_t longest_gap() const;
  /// Smallest similarity between delivered neighbours; -1 with fewer than two.
  int smallest_similarity() const;
};

/// Reads the journal of `folder` and computes the similarities from its images with the
/// daemon's own extractor at its default settings; in a stereo session, the left ones. Throws
/// std::runtime_error, also if a delivered frame lacks its right image where others have one.
SessionOutcome read_session(const std::string& label, const std::filesystem::path& folder);

}  // namespace orbbuf::bench
