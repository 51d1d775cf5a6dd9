// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/drop_queue.hpp"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <string>
#include <type_traits>
#include <utility>

#include "common/error.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kRecordBytes = sizeof(DropRecord);
static_assert(std::is_trivially_copyable_v<DropRecord>);

}  // namespace

DropQueue::DropQueue(std::filesystem::path folder, std::size_t most_in_memory)
    : folder_(std::move(folder)), most_in_memory_(most_in_memory) {}

std::filesystem::path DropQueue::default_folder() {
  if (const char* const state = std::getenv("STATE_DIRECTORY")) return state;
  std::error_code failed;
  return std::filesystem::temp_directory_path(failed);
}

void DropQueue::push(std::span<const DropRecord> records) {
  if (in_file() == 0 && newest_.empty()) {
    const auto count =
        std::min(records.size(), most_in_memory_ - std::min(oldest_.size(), most_in_memory_));
    oldest_.insert(oldest_.end(), records.begin(),
                   records.begin() + static_cast<std::ptrdiff_t>(count));
    records = records.subspan(count);
  }
  if (records.empty()) return;
  newest_.insert(newest_.end(), records.begin(), records.end());
  write_newest();
}

void DropQueue::pop(std::uint64_t count) {
  count = std::min(count, size());
  while (count > 0 && !oldest_.empty()) {
    const auto here = std::min<std::uint64_t>(count, oldest_.size());
    oldest_.erase(oldest_.begin(), oldest_.begin() + static_cast<std::ptrdiff_t>(here));
    count -= here;
    fill_oldest();
  }
}

bool DropQueue::open_file() {
  if (file_) return true;
  std::string name = (folder_ / "drops-XXXXXX").string();
  file_ = UniqueFd(::mkostemp(name.data(), O_CLOEXEC));
  if (file_) ::unlink(name.c_str());
  return static_cast<bool>(file_);
}

void DropQueue::write_newest() {
  const std::size_t bytes = newest_.size() * kRecordBytes;
  if (!open_file()) return complain("cannot make a file for drop records in ");
  const ssize_t done =
      ::pwrite(file_.get(), newest_.data(), bytes, static_cast<off_t>(written_ * kRecordBytes));
  if (done < 0) return complain("cannot write drop records to a file in ");
  const auto whole = static_cast<std::size_t>(done) / kRecordBytes;
  written_ += whole;
  newest_.erase(newest_.begin(), newest_.begin() + static_cast<std::ptrdiff_t>(whole));
}

void DropQueue::fill_oldest() {
  if (oldest_.size() > most_in_memory_ / 2) return;
  const auto room = most_in_memory_ - oldest_.size();
  std::vector<DropRecord> records(
      static_cast<std::size_t>(std::min<std::uint64_t>(room, in_file())));
  if (!records.empty()) {
    const ssize_t done = ::pread(file_.get(), records.data(), records.size() * kRecordBytes,
                                 static_cast<off_t>(read_ * kRecordBytes));
    if (done < 0) return complain("cannot read drop records from a file in ");
    records.resize(static_cast<std::size_t>(done) / kRecordBytes);
    oldest_.insert(oldest_.end(), records.begin(), records.end());
    read_ += records.size();
  }
  if (in_file() > 0) return;
  if (written_ > 0 && ::ftruncate(file_.get(), 0) == 0) written_ = read_ = 0;
  push(std::exchange(newest_, {}));
}

void DropQueue::complain(const char* attempt) {
  if (std::exchange(has_complained_, true)) return;
  spdlog::error("{}", system_error(attempt + folder_.string(), errno).text);
}

}  // namespace orbbuf
