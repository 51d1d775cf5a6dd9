// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "server/recording/sequence_set.hpp"
#include "server/recording/session_lines.hpp"

namespace orbbuf {

/// The frames of a session that came late, as its late.csv has them: in the order in which they
/// came.
using LateList = std::vector<session_lines::Late>;

/// Changes nothing. What is no line of ours is passed over, a torn last one with it; no file is an
/// empty list. Blocking; reentrant.
Result<LateList> read_late(const std::filesystem::path& folder);

/// The same, after what a kill or a power cut has left at the end of the file is cut off: a torn
/// line, and the lines of frames that are not whole. Images are compared with their checksums from
/// the newest frame backwards until kTrueRun in succession are whole; all from the oldest false one
/// on moves to orphans/. No such frame was acknowledged, and the robot sends it again. A frame that
/// times.txt has was merged, and is believed. Blocking; reentrant.
Result<LateList> recover_late(const std::filesystem::path& folder);

/// Their numbers.
SequenceSet numbers_of(const LateList& late);

/// The numbers that times.txt has; of nothing, none.
Result<SequenceSet> read_times_numbers(const std::filesystem::path& folder);

/// Where an image of a late frame is, in the session's folder; `image`: where it belongs. In late/
/// until a merge moves it, and if it is in neither.
std::string place_of_late_image(const std::filesystem::path& folder, const std::string& image);

/// Whether the frame's images are there as they were received.
bool is_whole(const std::filesystem::path& folder, const session_lines::Late& late);

}  // namespace orbbuf
