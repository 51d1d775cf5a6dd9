// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>

#include "common/error.hpp"

namespace orbbuf {

/// What a merge has done.
struct MergedLate {
  std::size_t frames = 0;   ///< that times.txt has now and did not have before
  std::size_t missing = 0;  ///< whose images are not there as they came: moved to orphans/
  bool is_complete = true;  ///< false: it was stopped
};

/// Puts a session's late frames (LateFiles) where they belong: their messages into the recording
/// SESSION.mcap, if there is one, their images and checksums to the others, their lines into
/// times.txt, which is sorted by number then. In drops.csv the reason of each becomes `late`; no
/// line comes or goes. Then late/ is removed: it is there exactly as long as something is not
/// merged. Does nothing without it.
///
/// Requires that the session is over for its live stream, and no SessionFiles, LateFiles or Backlog
/// has it open: the lists are replaced.
///
/// It may be killed at any moment, or the machine lose its power: then the next call completes it,
/// with nothing lost and nothing twice, and SessionFiles::recover() in between changes nothing of
/// it. So after an error. All but the lists is on the device before the lists are replaced, and
/// these before late/ goes. `may_go_on` is asked before each change of a file; if it says no, the
/// merge ends there as by a kill. folder: PATH/ROBOT/SESSION. Reads each late image once or twice.
/// Blocking; reentrant.
Result<MergedLate> merge_late(
    const std::filesystem::path& folder,
    const std::function<bool()>& may_go_on = [] { return true; });

}  // namespace orbbuf
