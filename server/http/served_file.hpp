// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "common/unique_fd.hpp"

namespace orbbuf {

/// A file of a session, read from its beginning a piece at a time, so that the thread that also
/// writes frames is never kept from that for long. Blocking; reentrant.
class ServedFile {
 public:
  static constexpr std::size_t kPieceBytes = 64UL * 1024;

  /// Null if `path` is not a file that can be read; a link is none.
  static std::shared_ptr<ServedFile> open(const std::filesystem::path& path);

  /// When it was opened: what comes later is not read.
  std::uint64_t size() const { return size_; }
  /// The next piece; empty at the end, and early if the file has become shorter or is broken.
  std::vector<std::uint8_t> read();

 private:
  ServedFile(UniqueFd file, std::uint64_t size) : file_(std::move(file)), size_(size) {}

  UniqueFd file_;
  const std::uint64_t size_;
  std::uint64_t position_ = 0;
};

}  // namespace orbbuf
