// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/part.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>
#include <utility>
#include <variant>

#include "common/file_io.hpp"
#include "common/log.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf::mcap {
namespace {

namespace fs = std::filesystem;

/// The whole JPEG has taken the place of what came.
bool is_replaced(const fs::path& folder, const RecordedFrame& frame) {
  std::error_code failed;
  const auto bytes = fs::file_size(folder / session_names::left_image(frame.sequence), failed);
  return !failed && bytes != (frame.is_stereo() ? frame.left_bytes : frame.bytes);
}

}  // namespace

std::string part_name(const std::string& session_id, std::uint32_t number) {
  return fmt::format("{}-{:04}.mcap", session_id, number);
}

PartMaker::PartMaker(fs::path folder, const SessionSummary& summary, RecordedPart part)
    : folder_(std::move(folder)),
      info_(summary.info),
      clock_offset_ns_(summary.closing.clock_offset_ns.value_or(0)),
      part_(part),
      path_(folder_ / part_name(info_.session_id, part.number)),
      temporary_(path_.string() + ".tmp"),
      reader_(folder_, part.from) {}

PartMaker::~PartMaker() {
  if (recording_) ::unlink(temporary_.c_str());
}

Result<bool> PartMaker::go_on() {
  for (;;) {
    const auto entry = reader_.next();
    if (!entry) return entry.error();
    if (!entry.value() || entry.value()->place >= part_.to) break;
    const auto is_written = add_record(entry.value()->record.body);
    if (!is_written) return is_written.error();
    if (is_written.value()) return false;
  }
  if (next_late_ == 0) std::ranges::stable_sort(late_, {}, &RecordedFrame::sequence);
  while (next_late_ < late_.size()) {
    const auto is_written = add(late_[next_late_++]);
    if (!is_written) return is_written.error();
    if (is_written.value()) return false;
  }
  if (auto error = finish()) return std::move(*error);
  return true;
}

/// The file is begun with the first message.
template <class Item>
Result<bool> PartMaker::put(const Item& item) {
  if (!recording_) {
    auto recording = Recording::create(temporary_, info_);
    if (!recording) return std::move(recording).error();
    recording_.emplace(std::move(recording).value());
  }
  return recording_->add(item);
}

Result<bool> PartMaker::add_record(const RecordBody& body) {
  if (const auto* const frame = std::get_if<RecordedFrame>(&body)) {
    part_.image_bytes += std::uint64_t{frame->bytes} - frame->replaced_bytes;
    if (!frame->is_late) {
      live_.insert(frame->sequence);
      return add(*frame);
    }
    if (!frame->is_replacing || !live_.contains(frame->sequence)) late_.push_back(*frame);
  }
  const auto* const items = std::get_if<RecordedItems>(&body);
  if (items != nullptr && items->stream >= wire::kFirstOther) return put(*items);
  Result<bool> is_written = false;
  auto drops = named_by(body);
  are_drops_cut_ = cut(drops, drops_left_) || are_drops_cut_;
  for (const DropRecord& drop : drops) {
    drops_left_ -= drop.frames;
    auto added = put(drop);
    if (!added || added.value()) is_written = std::move(added);
    if (!is_written) break;
  }
  return is_written;
}

Result<bool> PartMaker::add(const RecordedFrame& frame) {
  const auto images = read_images(folder_, frame);
  if (images) return put(images.value());
  if (!are_images_gone(folder_, frame)) return images.error();
  if (missing_++ == 0) {
    log_warn("{}: frame {} is passed over: {}", path_.string(), frame.sequence,
             images.error().text);
  }
  return false;
}

std::optional<Error> PartMaker::finish() {
  if (missing_ > 1) log_warn("{}: {} frames are passed over", path_.string(), missing_);
  if (are_drops_cut_) {
    log_warn("{} has the first {} dropped frames only", path_.string(), kMostDrops);
  }
  if (!recording_) return std::nullopt;
  if (part_.number == 1 && !recording_->problem().empty()) {
    log_warn("{}: without calibration: {}", path_.string(), recording_->problem());
  }
  if (auto error = recording_->finish(clock_offset_ns_)) return error;
  if (auto error = sync(temporary_)) return error;
  if (auto error = move_file(temporary_, path_)) return error;
  return sync(folder_);
}

bool lacks_part(const fs::path& folder) {
  const auto summary = read_summary(folder);
  if (!summary || !summary->part) return false;
  RecordReader reader(folder, summary->part->to);
  for (;;) {
    const auto entry = reader.next();
    if (!entry || !entry.value()) return false;
    const RecordBody& body = entry.value()->record.body;
    const bool is_recorded =
        std::holds_alternative<RecordedFrame>(body) || std::holds_alternative<RecordedItems>(body);
    if (is_recorded || !named_by(body).empty()) return true;
  }
}

std::optional<Error> remove_images(const fs::path& folder, const RecordedPart& part) {
  const auto segments = journal::segments_in(folder);
  if (!segments) return segments.error();
  for (const std::uint32_t segment : segments.value()) {
    if (segment < part.from.segment) continue;
    if (auto error = sync(journal::segment_path(folder, segment))) return error;
  }
  if (auto error = sync(folder)) return error;
  std::optional<Error> failed;
  const auto remove = [&](const std::string& image) {
    if (failed || ::unlink((folder / image).c_str()) == 0 || errno == ENOENT) return;
    failed = system_error("remove " + (folder / image).string(), errno);
  };
  const auto remove_of = [&](const RecordedFrame& frame) {
    if (frame.is_reduced() && is_replaced(folder, frame)) return;
    remove(session_names::left_image(frame.sequence));
    if (frame.is_stereo()) remove(session_names::right_image(frame.sequence));
  };
  auto error = for_each<RecordedFrame>(folder, remove_of, part.from, part.to);
  return error ? error : failed;
}

std::optional<Error> remove_images(const fs::path& folder) {
  const auto summary = read_summary(folder);
  if (!summary || !summary->part || !summary->part->is_only_copy) return std::nullopt;
  return remove_images(folder, *summary->part);
}

Result<SequenceSet> numbers_without_images(const fs::path& folder) {
  std::vector<RecordedPart> parts;
  const auto error = for_each<RecordedPart>(folder, [&](const RecordedPart& part) {
    if (part.is_only_copy) parts.push_back(part);
  });
  if (error) return *error;
  SequenceSet numbers;
  const auto insert = [&](const RecordedFrame& frame) { numbers.insert(frame.sequence); };
  for (const RecordedPart& part : parts) {
    const auto failed = for_each<RecordedFrame>(folder, insert, part.from, part.to);
    if (failed) return *failed;
  }
  return numbers;
}

}  // namespace orbbuf::mcap
