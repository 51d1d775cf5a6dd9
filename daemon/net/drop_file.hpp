// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>

#include "common/drop_record.hpp"
#include "common/wire.hpp"

namespace orbbuf {

/// The robot's own record of a session, SESSION.csv in a folder: what the server has as drops.csv,
/// and, as comments, how far the session got:
///
///     # captured,120,confirmed,117
///     # ended,captured,125,confirmed,125
///
/// A frame is confirmed if the server has acknowledged it, or if a line of the file names it. A
/// file without the second line is of a session that did not end in order.
///
/// An error costs the record, never the stream: it is logged once. Thread-bound to `main`; no
/// thread that captures waits for a write.
class DropFile {
 public:
  /// Files of sessions in the folder, at most. The oldest are removed.
  static constexpr std::size_t kMostFiles = 100;

  /// No file.
  DropFile() = default;
  /// Begins the file. Says in the log if the session before this one did not end in order. Touches
  /// no file in `folder` but those that are named like sessions.
  DropFile(const std::filesystem::path& folder, const std::string& session_id);

  void add(std::span<const DropRecord> records);
  /// A line, if it differs from the one before. To be called once a second at most, with stats that
  /// are newer than the last add().
  void note(const wire::Stats& stats);
  /// The orderly end. A session without a frame leaves no file.
  void end(const wire::Stats& stats);

 private:
  std::string counts(const wire::Stats& stats) const;
  void flush();
  void give_up(int error);

  std::filesystem::path path_;
  std::ofstream file_;
  std::uint64_t named_ = 0;  // records in the file
  std::string noted_;
};

}  // namespace orbbuf
