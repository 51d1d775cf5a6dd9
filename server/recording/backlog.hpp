// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "server/recording/session_lines.hpp"

namespace orbbuf {

/// Reads a session's frames back from its folder (SessionFiles), in order, while it still grows.
/// Blocking; reentrant.
class Backlog {
 public:
  explicit Backlog(std::filesystem::path folder);

  /// The first frame from `first` on that is there; null if there is none yet. Its geometry and
  /// exposure are not known, nor is the quality of a late frame; that of a frame which a power cut
  /// made come again may be that of the first time. A frame whose images cannot be
  /// read is passed over with a warning. An error if the list of frames cannot be read. Cost: the
  /// frame's images and at most 4 KiB of each list, but all of these up to `first` in the first
  /// call and in one for an earlier frame than the last.
  Result<FramePtr> next(Sequence first);

 private:
  /// The lines of a list, one after the other, while it grows.
  class Lines {
   public:
    explicit Lines(std::filesystem::path path) : path_(std::move(path)) {}
    /// Without its end, valid until the next call; nothing if there is no whole one yet.
    Result<std::optional<std::string_view>> next();
    void rewind();

   private:
    const std::filesystem::path path_;
    off_t offset_ = 0;       // where the next line begins
    std::string block_;      // what was read last
    std::size_t begin_ = 0;  // of the next line in it
  };

  Result<FramePtr> load(Sequence sequence, std::int64_t capture_time_ns);
  session_lines::Quality quality_of(Sequence sequence);

  const std::filesystem::path folder_;
  Lines times_;
  Lines qualities_;
  std::optional<session_lines::Quality> quality_;  // the last one read
  Sequence first_ = 0;                             // as the last call had it
};

}  // namespace orbbuf
