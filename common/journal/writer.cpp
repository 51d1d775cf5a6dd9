// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

#include "common/file_io.hpp"
#include "common/journal/format.hpp"
#include "common/journal/journal.hpp"

namespace orbbuf::journal {

namespace fs = std::filesystem;

Writer::Writer(fs::path folder, std::uint64_t segment_bytes, bool is_synced, Checkpoint checkpoint)
    : folder_(std::move(folder)),
      segment_bytes_(segment_bytes),
      is_synced_(is_synced),
      checkpoint_(std::move(checkpoint)) {}

std::optional<Error> Writer::open(const Place& end) {
  end_ = end;
  is_segment_due_ = true;  // after an error, too: what is there is not overwritten
  const auto segments = segments_in(folder_);
  if (!segments) return segments.error();
  for (const std::uint32_t segment : segments.value()) {
    if (segment <= end.segment) continue;
    if (auto error = remove(segment)) return error;
  }
  const fs::path path = segment_path(folder_, end.segment);
  file_ = UniqueFd(::open(path.c_str(), O_WRONLY | O_CLOEXEC));
  if (!file_ && errno != ENOENT) return system_error("open " + path.string(), errno);
  is_segment_due_ = !file_ || end.offset == 0;
  return file_ ? restore() : std::nullopt;
}

/// To its length before what a failed append, or a power cut, has left.
std::optional<Error> Writer::restore() {
  must_restore_ = true;
  if (::ftruncate(file_.get(), static_cast<off_t>(end_.offset)) != 0) {
    return system_error("truncate " + segment_path(folder_, end_.segment).string(), errno);
  }
  must_restore_ = false;
  return std::nullopt;
}

Result<Place> Writer::append(std::uint8_t type,
                             std::initializer_list<std::span<const std::uint8_t>> parts) {
  if (must_restore_) {
    if (auto error = restore()) return std::move(*error);
  }
  if (!file_ || is_segment_due_ || end_.offset >= segment_bytes_) {
    const bool is_first = !file_ && !is_segment_due_;
    const bool is_empty = end_.offset == 0;  // of the present number nothing is there
    if (auto error = begin_segment(is_first || is_empty ? end_.segment : end_.segment + 1)) {
      return std::move(*error);
    }
  }
  const Place place = end_;
  if (auto error = write(type, parts)) return std::move(*error);
  return place;
}

std::optional<Error> Writer::begin_segment(std::uint32_t segment) {
  const fs::path path = segment_path(folder_, segment);
  UniqueFd file(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!file) return system_error("create " + path.string(), errno);
  std::swap(file_, file);
  const Place before = std::exchange(end_, Place{segment, 0});
  const auto body = checkpoint_();
  if (auto error = write(kCheckpoint, {body})) {
    std::swap(file_, file);
    end_ = before;
    must_restore_ = false;  // the file goes
    ::unlink(path.c_str());
    return error;
  }
  if (file && is_synced_) unsynced_.push_back(std::move(file));
  is_folder_unsynced_ = true;
  is_segment_due_ = false;
  return std::nullopt;
}

std::optional<Error> Writer::write(std::uint8_t type,
                                   std::initializer_list<std::span<const std::uint8_t>> parts) {
  record_.assign(kHeadBytes, 0);
  for (const auto& part : parts) record_.insert(record_.end(), part.begin(), part.end());
  store_head(type, record_);
  if (auto error =
          write_all_at(file_.get(), end_.offset, record_, segment_path(folder_, end_.segment))) {
    restore();
    return error;
  }
  end_.offset += record_.size();
  return std::nullopt;
}

std::optional<Error> Writer::sync() {
  while (!unsynced_.empty()) {
    const UniqueFd file = std::move(unsynced_.back());
    unsynced_.pop_back();  // in any case: the kernel reports an error once
    if (::fdatasync(file.get()) != 0) {
      return system_error("sync a segment of " + folder_.string(), errno);
    }
  }
  if (!file_) return std::nullopt;
  if (::fdatasync(file_.get()) != 0) {
    return system_error("sync " + segment_path(folder_, end_.segment).string(), errno);
  }
  if (!is_folder_unsynced_) return std::nullopt;
  if (auto error = orbbuf::sync(folder_)) return error;
  is_folder_unsynced_ = false;
  return std::nullopt;
}

std::optional<Error> Writer::remove(std::uint32_t segment) {
  const fs::path path = segment_path(folder_, segment);
  if (::unlink(path.c_str()) == 0 || errno == ENOENT) return std::nullopt;
  return system_error("remove " + path.string(), errno);
}

bool Writer::is_there() const {
  struct stat ours {};
  struct stat named {};
  return !file_ || (::fstat(file_.get(), &ours) == 0 &&
                    ::stat(segment_path(folder_, end_.segment).c_str(), &named) == 0 &&
                    ours.st_dev == named.st_dev && ours.st_ino == named.st_ino);
}

}  // namespace orbbuf::journal
