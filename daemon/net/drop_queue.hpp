// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <span>
#include <vector>

#include "common/drop_record.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {

/// Drop records in order, of which the oldest are in memory. Beyond `most_in_memory` of them the
/// rest goes to a file without a name in `folder`, 24 bytes a record, and comes back as the oldest
/// leave; a week without a server at 25 fps is 360 MB. Records that cannot be written, for example
/// because the disk is full, stay in memory and are tried again. Thread-bound.
class DropQueue {
 public:
  static constexpr std::size_t kMostInMemory = 65536;

  explicit DropQueue(std::filesystem::path folder = default_folder(),
                     std::size_t most_in_memory = kMostInMemory);

  void push(std::span<const DropRecord> records);
  /// Adds older ones than the oldest. They stay in memory.
  void put_back(std::span<const DropRecord> records) {
    oldest_.insert(oldest_.begin(), records.begin(), records.end());
  }
  /// Removes the oldest `count`, at most size().
  void pop(std::uint64_t count);

  std::uint64_t size() const { return oldest_.size() + in_file() + newest_.size(); }
  /// The oldest ones, which are in memory. Not empty unless the queue is, or its file cannot be
  /// read.
  const std::deque<DropRecord>& oldest() const { return oldest_; }

 private:
  /// $STATE_DIRECTORY, which systemd sets, or that of temporary files.
  static std::filesystem::path default_folder();

  std::uint64_t in_file() const { return written_ - read_; }
  bool open_file();
  void write_newest();
  void fill_oldest();
  void complain(const char* attempt);

  const std::filesystem::path folder_;
  const std::size_t most_in_memory_;
  std::deque<DropRecord> oldest_;
  UniqueFd file_;
  std::uint64_t written_ = 0;  // records, from the begin of file_
  std::uint64_t read_ = 0;
  std::vector<DropRecord> newest_;  // empty unless file_ does not take them
  bool has_complained_ = false;
};

}  // namespace orbbuf
