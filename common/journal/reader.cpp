// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <system_error>
#include <utility>

#include "common/byte_order.hpp"
#include "common/crc32.hpp"
#include "common/decimal.hpp"
#include "common/file_io.hpp"
#include "common/journal/format.hpp"
#include "common/journal/journal.hpp"

namespace orbbuf::journal {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kName = "journal.";

std::optional<std::uint32_t> number_of(const std::string& name) {
  if (!name.starts_with(kName) || name.size() < kName.size() + 6) return std::nullopt;
  return parse_number<std::uint32_t>(std::string_view(name).substr(kName.size()));
}

}  // namespace

fs::path segment_path(const fs::path& folder, std::uint32_t segment) {
  return folder / fmt::format("{}{:06}", kName, segment);
}

Result<std::vector<std::uint32_t>> segments_in(const fs::path& folder) {
  std::vector<std::uint32_t> segments;
  std::error_code failed;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    if (const auto number = number_of(entry->path().filename().string())) {
      segments.push_back(*number);
    }
  }
  if (failed && failed != std::errc::no_such_file_or_directory) {
    return system_error("read " + folder.string(), failed.value());
  }
  std::ranges::sort(segments);
  return segments;
}

Reader::Reader(fs::path folder, Place from) : folder_(std::move(folder)), place_(from) {}

std::optional<Error> Reader::open(std::uint32_t segment) {
  block_.clear();
  block_begin_ = 0;
  auto file = open_regular(segment_path(folder_, segment));
  if (!file) return std::move(file).error();
  file_ = std::move(file).value();
  return std::nullopt;
}

/// As many as the file has, at most `count`.
Result<std::span<const std::uint8_t>> Reader::bytes_at(std::uint64_t offset, std::size_t count) {
  const bool is_there = offset >= block_begin_ && offset + count <= block_begin_ + block_.size();
  if (!is_there) {
    block_.resize(std::max(count, kBlockBytes));
    block_begin_ = offset;
    const auto path = segment_path(folder_, place_.segment);
    auto got = read_at(file_.get(), offset, block_, path);
    if (!got && block_.size() > count) {  // perhaps only what is behind cannot be read
      block_.resize(count);
      got = read_at(file_.get(), offset, block_, path);
    }
    block_.resize(got ? got.value() : 0);
    if (!got) return got.error();
  }
  const auto rest = std::span(block_).subspan(static_cast<std::size_t>(offset - block_begin_));
  return rest.first(std::min(count, rest.size()));
}

/// Nothing: none that is whole begins there.
Result<std::optional<Record>> Reader::record_at(std::uint64_t offset) {
  const auto head = bytes_at(offset, kHeadBytes);
  if (!head) return head.error();
  const auto parsed = parse_head(head.value());
  if (!parsed) return std::nullopt;
  const auto bytes = bytes_at(offset, kHeadBytes + parsed->body_bytes);
  if (!bytes) return bytes.error();
  if (bytes.value().size() < kHeadBytes + parsed->body_bytes) return std::nullopt;
  const auto body = bytes.value().subspan(kHeadBytes);
  if (crc32(body, parsed->head_crc) != parsed->crc) return std::nullopt;
  return Record{parsed->type,
                {place_.segment, offset},
                {place_.segment, offset + bytes.value().size()},
                body};
}

/// The offset of the first valid record from `from` on in the segment.
Result<std::optional<std::uint64_t>> Reader::find_record(std::uint64_t from) {
  std::array<std::uint8_t, 4> magic{};
  wire::store(magic.data(), kMagic);
  for (;;) {
    const auto read = bytes_at(from, kBlockBytes);
    if (!read) return read.error();
    const auto bytes = read.value();
    const auto found = std::search(bytes.begin(), bytes.end(), magic.begin(), magic.end());
    if (found == bytes.end()) {
      if (bytes.size() < kBlockBytes) return std::nullopt;
      from += kBlockBytes - magic.size() + 1;
      continue;
    }
    from += static_cast<std::uint64_t>(found - bytes.begin());
    const auto record = record_at(from);
    if (!record) return record.error();
    if (record.value()) return from;
    ++from;
  }
}

/// Passes over what is damaged before it.
Result<std::optional<Record>> Reader::find_in_segment() {
  if (!file_) return std::nullopt;
  auto record = record_at(place_.offset);
  if (!record || record.value()) return record;
  const auto found = find_record(place_.offset);
  if (!found) return found.error();
  if (!found.value()) return std::nullopt;
  damaged_bytes_ += *found.value() - place_.offset;
  place_.offset = *found.value();
  return record_at(place_.offset);
}

Result<std::optional<Record>> Reader::next() {
  for (bool is_last_look = false;; is_last_look = !is_last_look) {
    if (!file_) {
      if (auto error = open(place_.segment)) return std::move(*error);
    }
    auto record = find_in_segment();
    if (!record) return record;
    if (record.value()) {
      place_ = record.value()->end;
      return record;
    }
    block_.clear();  // what is there may still be written
    const auto segment = next_segment();
    if (!segment) return segment.error();
    if (!segment.value()) return std::nullopt;
    if (!is_last_look) continue;  // for what was written before the next segment was made
    leave_segment();
    place_ = {*segment.value(), 0};
  }
}

/// Mostly without a list of all, of which there may be thousands.
Result<std::optional<std::uint32_t>> Reader::next_segment() const {
  const std::uint32_t following = place_.segment + 1;
  std::error_code unknown;
  if (following > 0 && fs::exists(segment_path(folder_, following), unknown)) return following;
  const auto segments = segments_in(folder_);
  if (!segments) return segments.error();
  const auto next = std::ranges::upper_bound(segments.value(), place_.segment);
  if (next == segments.value().end()) return std::nullopt;
  return *next;
}

void Reader::leave_segment() {
  std::error_code unknown;
  const auto bytes = fs::file_size(segment_path(folder_, place_.segment), unknown);
  if (!unknown && bytes > place_.offset) damaged_bytes_ += bytes - place_.offset;
  file_ = {};
}

}  // namespace orbbuf::journal
