// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <filesystem>

#include "common/error.hpp"
#include "common/frame.hpp"

namespace orbbuf {

/// Reads a session's frames back from its folder (SessionFiles), in order, while it still grows.
/// Blocking; reentrant.
class Backlog {
 public:
  explicit Backlog(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// The first frame from `first` on that is there; null if there is none yet. Its geometry and
  /// exposure are not known. A frame whose images cannot be read is
  /// passed over with a warning. An error if the list of frames cannot be read.
  /// Cost: the frame's images and 4 KiB of times.txt, but all of that up to `first` in the first
  /// call and in one for an earlier frame than the last.
  Result<FramePtr> next(Sequence first);

 private:
  Result<FramePtr> load(Sequence sequence, std::int64_t capture_time_ns) const;

  const std::filesystem::path folder_;
  off_t offset_ = 0;    // in times.txt, where the next line begins
  Sequence first_ = 0;  // as the last call had it
};

}  // namespace orbbuf
