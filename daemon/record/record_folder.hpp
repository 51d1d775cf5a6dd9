// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/journal/journal.hpp"
#include "common/unique_fd.hpp"
#include "daemon/record/record_state.hpp"

namespace orbbuf {

/// The folder of the robot's record: its lock, and what its journal has. Other files in it are left
/// alone. Reentrant; blocks on the disk.
class RecordFolder {
 public:
  explicit RecordFolder(std::filesystem::path path) : path_(std::move(path)) {}

  /// Makes the folder if it is absent, and locks it, for as long as this lives, by the file `lock`.
  /// Again: after it was removed.
  struct LockError : Error {
    bool is_taken = false;  ///< by another process
  };
  std::optional<LockError> lock();

  /// Where the journal ends.
  struct End {
    journal::Place place;
    std::uint64_t checkpoint_bytes = 0;  ///< of the segment of `place`; 0: there is none
    record_format::Index index;          ///< of that segment
  };
  /// Tells `state`, before its begin(), what the journal has. Reads the newest segment, and of the
  /// others the index; all of one that has none. What cannot be read is logged, and lost. An error
  /// if the folder itself cannot be read.
  Result<End> read(RecordState& state) const;

  /// Null, or nothing: it is damaged. An error: it cannot be read, at the moment at least.
  Result<FramePtr> read_frame(const KeptFrame& frame) const;
  Result<std::optional<wire::Items>> read_items(const KeptFrame& items) const;

 private:
  using Segments = std::vector<std::uint32_t>;
  std::size_t find_checkpoint(const Segments& segments, RecordState& state) const;
  End read_from(std::uint32_t segment, std::uint32_t last, RecordState& state) const;
  record_format::Index index_of(std::uint32_t segment) const;
  std::optional<record_format::Index> read_index(std::uint32_t segment) const;

  const std::filesystem::path path_;
  UniqueFd lock_;
};

}  // namespace orbbuf
