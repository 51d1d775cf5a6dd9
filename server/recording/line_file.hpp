// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "common/error.hpp"

namespace orbbuf {

/// A text file that grows by whole lines, each ended by '\n'.
///
/// It is opened for each append, so that idle sessions hold no descriptors and a file that
/// was removed comes back. No fsync. Blocking; reentrant.
class LineFile {
 public:
  struct Content {
    std::uint64_t lines = 0;  ///< complete ones, the first line included
    std::string last;         ///< without the line end; at most its first 255 bytes
  };

  /// first_line, if not empty, is written before anything else into an empty file.
  explicit LineFile(std::filesystem::path path, std::string first_line = "");

  /// What is there, after a torn last line has been cut off. A missing file is an empty one.
  /// Reads all of the file.
  Result<Content> recover();

  /// Adds `lines`, which end in '\n'. On error the file is as long as before, unless even that
  /// fails: then the next append cuts it first.
  std::optional<Error> append(std::string_view lines);

  const std::filesystem::path& path() const { return path_; }

 private:
  std::optional<Error> cut(int fd, off_t bytes);

  std::filesystem::path path_;
  std::string first_line_;
  std::optional<off_t> cut_due_;  // what a failed append left behind begins here
};

}  // namespace orbbuf
