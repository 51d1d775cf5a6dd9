// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "common/error.hpp"
#include "common/frame.hpp"

namespace orbbuf {

/// Where a session's list of frames stops being true. After a power cut lines may be on the device
/// whose images are not, or not whole.
struct FalseTail {
  std::uint64_t offset = 0;           ///< in times.txt: the lines from here on are false
  std::string lines;                  ///< these; empty: all are true
  std::size_t frames = 0;             ///< how many they are
  std::optional<Sequence> last_true;  ///< the frame before them
};

/// Compares images with their checksums, from the newest frame backwards, until kTrueRun frames in
/// succession are whole; all from the oldest false one on is the false tail. A frame without a
/// checksum is false, unless it is older than all that have one. Reads the lists, and kTrueRun
/// images at least; lines that are no lines of ours are passed over. Blocking; reentrant.
Result<FalseTail> find_false_tail(const std::filesystem::path& folder);

inline constexpr std::size_t kTrueRun = 256;

/// Moves a file of a session's folder to the same place below its folder `orphans`, which is made;
/// a number is added to a name that is taken. False: it is not there.
Result<bool> move_to_orphans(const std::filesystem::path& folder, const std::string& name);

}  // namespace orbbuf
