// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record_folder.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <span>
#include <system_error>
#include <utility>

#include "common/file_io.hpp"
#include "common/log.hpp"

namespace orbbuf {

namespace fs = std::filesystem;
using journal::Reader;
using record_format::Index;

namespace {

void log_unreadable(const Error& error) {
  log_error("record: {}; what it has from there on is lost", error.text);
}

KeptFrame place_of(const journal::Record& record, Sequence sequence) {
  return {sequence, record.place.segment, static_cast<std::uint32_t>(record.place.offset),
          static_cast<std::uint32_t>(record.end.offset - record.place.offset),
          KeptFrame::State::kWritten};
}

void add(const journal::Record& record, Index& index) {
  if (record.type == record_format::kFrame) {
    if (const auto frame = record_format::parse_frame(record.body)) {
      index[frame->first].kept.push_back(place_of(record, frame->second.sequence));
    }
  } else if (record.type == record_format::kReleased) {
    if (const auto parsed = record_format::parse_released(record.body)) {
      auto& released = index[parsed->first].released;
      released.insert(released.end(), parsed->second.begin(), parsed->second.end());
    }
  } else if (record.type == record_format::kItems) {
    if (const auto parsed = record_format::parse_items(record.body)) {
      KeptFrame items = place_of(record, parsed->second.first);
      items.count = record_format::count_of(parsed->second);
      index[parsed->first].items.emplace_back(parsed->second.stream, items);
    }
  }
}

}  // namespace

std::optional<RecordFolder::LockError> RecordFolder::lock() {
  lock_ = UniqueFd();
  const std::string attempt = "cannot write to the folder " + path_.string();
  std::error_code failed;
  fs::create_directories(path_, failed);
  if (failed) {
    return LockError{system_error("cannot make the folder " + path_.string(), failed.value())};
  }
  constexpr mode_t kMode = 0600;
  const fs::path name = path_ / "lock";
  UniqueFd file(::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kMode));
  const bool is_writable = file && ::access(path_.c_str(), W_OK | X_OK) == 0;
  const int error = errno;
  // A disk may have become read-only under another one that uses it.
  if (!file) file = UniqueFd(::open(name.c_str(), O_RDONLY | O_CLOEXEC));
  const bool is_locked = file && ::flock(file.get(), LOCK_EX | LOCK_NB) == 0;
  if (file && !is_locked && errno == EWOULDBLOCK) {
    return LockError{{"cannot use the folder " + path_.string() + ": another orbbufd uses it"},
                     true};
  }
  if (!is_writable) return LockError{system_error(attempt, error)};
  if (!is_locked) return LockError{system_error(attempt, errno)};
  lock_ = std::move(file);
  return std::nullopt;
}

Result<RecordFolder::End> RecordFolder::read(RecordState& state) const {
  const auto found = journal::segments_in(path_);
  if (!found) return found.error();
  if (found.value().empty()) return End{};
  const Segments& segments = found.value();
  for (const auto segment : segments) {
    std::error_code unknown;
    const auto bytes = fs::file_size(journal::segment_path(path_, segment), unknown);
    state.add_segment(segment, unknown ? 0 : bytes);
  }
  const std::size_t newest = find_checkpoint(segments, state);
  for (const auto segment : std::span(segments).first(newest)) {
    state.apply(index_of(segment), false);
  }
  return read_from(segments[newest], segments.back(), state);
}

/// Which of the segments is the newest whose checkpoint is valid; the first, if none is.
std::size_t RecordFolder::find_checkpoint(const Segments& segments, RecordState& state) const {
  for (std::size_t i = segments.size(); i-- > 0;) {
    const journal::Place begin{segments[i], 0};
    Reader reader(path_, begin);
    const auto record = reader.next();
    const bool is_checkpoint = record && record.value() && record.value()->place == begin &&
                               record.value()->type == journal::kCheckpoint;
    if (is_checkpoint && state.apply_checkpoint(record.value()->body)) return i;
  }
  return 0;
}

/// Accounts and frames; accounts may name sessions that the checkpoint does not know.
RecordFolder::End RecordFolder::read_from(std::uint32_t segment, std::uint32_t last,
                                          RecordState& state) const {
  End end{{segment, 0}, 0, {}};
  Reader reader(path_, end.place);
  for (bool is_more = true; is_more;) {
    const auto record = reader.next();
    if (!record) log_unreadable(record.error());
    is_more = record && record.value();
    const auto place = record ? reader.place() : journal::Place{last + 1, 0};
    if (place.segment != end.place.segment || !is_more) state.apply(end.index, true);
    if (place.segment != end.place.segment) end = {};
    end.place = place;
    if (!is_more) break;
    if (record.value()->type == journal::kCheckpoint) end.checkpoint_bytes = place.offset;
    if (record.value()->type == record_format::kAccount) state.apply_account(record.value()->body);
    add(*record.value(), end.index);
  }
  if (reader.damaged_bytes() > 0) {
    log_warn("record: {} bytes in {} are damaged; what they said is lost", reader.damaged_bytes(),
             path_.string());
  }
  state.add_segment(end.place.segment, end.place.offset);
  return end;
}

record_format::Index RecordFolder::index_of(std::uint32_t segment) const {
  if (auto index = read_index(segment)) return std::move(*index);
  Index index;
  Reader reader(path_, {segment, 0});
  for (;;) {
    const auto record = reader.next();
    if (!record) log_unreadable(record.error());
    if (!record || !record.value() || record.value()->place.segment != segment) return index;
    add(*record.value(), index);
  }
}

/// Nothing: the segment does not end with one.
std::optional<Index> RecordFolder::read_index(std::uint32_t segment) const {
  const auto path = journal::segment_path(path_, segment);
  const UniqueFd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  std::error_code failed;
  const auto size = fs::file_size(path, failed);
  std::array<std::uint8_t, sizeof(std::uint32_t)> field{};
  if (failed || !file || size < field.size()) return std::nullopt;
  if (!read_at(file.get(), size - field.size(), field, path)) return std::nullopt;
  const std::uint64_t bytes =
      journal::kHeadBytes + wire::load<std::uint32_t>(field.data()) + field.size();
  if (bytes > size) return std::nullopt;
  const journal::Place place{segment, size - bytes};
  Reader reader(path_, place);
  const auto record = reader.next();
  const bool is_index = record && record.value() && record.value()->place == place &&
                        record.value()->type == record_format::kIndex;
  return is_index ? record_format::parse_index(record.value()->body, segment) : std::nullopt;
}

Result<std::optional<wire::Items>> RecordFolder::read_items(const KeptFrame& items) const {
  const journal::Place place{items.segment, items.offset};
  Reader reader(path_, place);
  const auto record = reader.next();
  if (!record) return record.error();
  const bool is_there = record.value() && record.value()->place == place &&
                        record.value()->type == record_format::kItems;
  auto parsed = is_there ? record_format::parse_items(record.value()->body) : std::nullopt;
  if (!parsed || parsed->second.first != items.sequence) return std::nullopt;
  return std::move(parsed->second);
}

Result<FramePtr> RecordFolder::read_frame(const KeptFrame& frame) const {
  const journal::Place place{frame.segment, frame.offset};
  Reader reader(path_, place);
  const auto record = reader.next();
  if (!record) return record.error();
  const bool is_frame = record.value() && record.value()->place == place &&
                        record.value()->type == record_format::kFrame;
  auto parsed = is_frame ? record_format::parse_frame(record.value()->body) : std::nullopt;
  if (!parsed || parsed->second.sequence != frame.sequence) return FramePtr();
  return FramePtr(std::make_shared<EncodedFrame>(std::move(parsed->second)));
}

}  // namespace orbbuf
