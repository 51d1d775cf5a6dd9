// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "common/error.hpp"
#include "common/journal/journal.hpp"
#include "common/unique_fd.hpp"
#include "server/session/durability.hpp"
#include "server/session/records.hpp"
#include "server/session/sequence_set.hpp"

/// What SessionStore does when it opens a session. Blocking; reentrant for different sessions.
namespace orbbuf {

/// With Durability::kOff the kept mark never moves: so many of the newest frames are compared.
inline constexpr std::size_t kMostCompared = 4096;

struct RecoveredSession {
  SessionSummary summary;
  journal::Place end;       ///< where the journal goes on
  journal::Place kept;      ///< the newest kept mark
  journal::Place compared;  ///< all from here on was found to be whole
  bool is_new = true;       ///< there is no record
  bool is_clean = false;    ///< nothing came since a RecordedEnd, and all views are made
};

/// Finds where the session's journal stops being true, and moves what it does not explain to
/// orphans/. After a power cut records may be on the device whose images are not, or not whole. All
/// before the kept mark is believed. From there on the images are compared with their records; the
/// journal ends at the first record that is damaged or whose images are not whole, and the robot
/// sends the rest again. Images of records behind that, and images at or past the position without
/// any record, are orphans, and so are temporary files, but for the image that completes a pair
/// that was being replaced. The journal itself is not changed, nor is anything before `end`.
///
/// Reads the newest segment and the segments from the kept mark on; after a kill also the names of
/// all images, and the whole journal if one image of a pair was left. `info`: of a session without
/// a record.
Result<RecoveredSession> recover_session(const std::filesystem::path& folder,
                                         const SessionInfo& info, Durability durability);

/// times.txt, open to be written at `bytes`.
struct TimesFile {
  UniqueFd fd;
  std::uint64_t bytes = 0;
};

/// Makes times.txt have a line for each live frame of the journal, and nothing behind them. The
/// lines of records before `from` are believed if the last one of them is there; else the file is
/// made anew.
Result<TimesFile> mend_times(const std::filesystem::path& folder, const journal::Place& from);

/// Moves the images of frames that are not among `there` to orphans/, and logs how many.
std::optional<Error> set_strangers_aside(const std::filesystem::path& folder,
                                         const SequenceSet& there);

/// Moves a file of a session's folder to the same place below its folder `orphans`, which is made;
/// a number is added to a name that is taken. False: it is not there.
Result<bool> move_to_orphans(const std::filesystem::path& folder, const std::string& name);

}  // namespace orbbuf
