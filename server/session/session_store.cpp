// SPDX-License-Identifier: Apache-2.0
#include "server/session/session_store.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <span>
#include <system_error>
#include <utility>
#include <variant>

#include "common/as_bytes.hpp"
#include "common/calibration/calibration.hpp"
#include "common/crc32.hpp"
#include "common/file_io.hpp"
#include "common/sample.hpp"
#include "server/session/session_lines.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"
#include "server/session/views.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kSegmentBytes = 1U << 20;

std::optional<Error> make_folder(const fs::path& folder) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed) return system_error("create " + folder.string(), failed.value());
  return std::nullopt;
}

bool has_bytes(const fs::path& path, std::span<const std::uint8_t> bytes) {
  std::error_code ignored;  // then it is as good as missing
  if (fs::file_size(path, ignored) != bytes.size() || ignored) return false;
  const auto content = read_file(path);
  return content && std::ranges::equal(content.value(), bytes);
}

RecordedFrame record_of(const EncodedFrame& frame, std::int64_t arrived_ns) {
  RecordedFrame record;
  record.sequence = frame.sequence;
  record.capture_time_ns = frame.capture_time_ns;
  record.arrived_ns = arrived_ns;
  record.exposure_ns = frame.exposure_ns;
  record.width_px = frame.width_px;
  record.height_px = frame.height_px;
  record.bytes = static_cast<std::uint32_t>(frame.jpeg.size());
  record.crc = frame.jpeg_crc;
  if (frame.is_stereo()) {
    record.left_bytes = frame.left_bytes;
    record.crc = crc32(frame.left());
    record.crc_right = crc32(frame.right());
  }
  record.whole_bytes = frame.whole_bytes;
  record.whole_crc = frame.whole_crc;
  record.quality = frame.quality;
  return record;
}

/// Whether `reduced` differs from `whole`, whose JPEG is `jpeg`, by its JPEG only.
bool is_reduced_from(const RecordedFrame& whole, const RecordedFrame& reduced,
                     std::span<const std::uint8_t> jpeg) {
  return whole.capture_time_ns == reduced.capture_time_ns &&
         whole.exposure_ns == reduced.exposure_ns && whole.width_px == reduced.width_px &&
         whole.height_px == reduced.height_px && whole.is_stereo() == reduced.is_stereo() &&
         !whole.is_reduced() && jpeg.size() == reduced.whole_bytes &&
         crc32(jpeg) == reduced.whole_crc;
}

}  // namespace

Result<std::unique_ptr<SessionStore>> SessionStore::open(fs::path folder, SessionInfo info,
                                                         Durability durability) {
  auto recovered = recover_session(folder, info, durability);
  if (!recovered) return std::move(recovered).error();
  const bool is_new = recovered.value().is_new;
  const bool is_mended = !is_new && !recovered.value().is_clean;
  const auto end = recovered.value().end;
  const bool is_weak = weak_file_system(folder.parent_path().parent_path()).has_value();
  std::unique_ptr<SessionStore> store(new SessionStore(
      std::move(folder), std::move(recovered).value(), is_weak && durability == Durability::kAck));
  if (auto error = store->journal_.open(end)) return std::move(*error);
  if (!is_new) store->calibrate(std::move(info.calibration));
  if (is_mended) store->mend_from(store->times_from_);
  return store;
}

SessionStore::SessionStore(fs::path folder, RecoveredSession recovered, bool is_synced)
    : folder_(std::move(folder)),
      is_synced_(is_synced),
      summary_(std::move(recovered.summary)),
      journal_(folder_, kSegmentBytes, is_synced, [this] { return encode(summary_, kept_); }),
      kept_(recovered.kept),
      is_new_(recovered.is_new),
      is_clean_(recovered.is_clean),
      times_from_(recovered.compared) {}

void SessionStore::calibrate(std::string calibration) {
  if (calibration.empty() || calibration == summary_.info.calibration) return;
  if (is_new_) {
    summary_.info.calibration = std::move(calibration);
  } else {
    calibration_ = std::move(calibration);
  }
  is_prepared_ = false;
}

void SessionStore::set_kept(const journal::Place& place) {
  kept_ = std::max(kept_, std::min(place, journal_.end()));
}

/// Folders, camera.txt and the journal, again after each failure, in case they were removed.
std::optional<Error> SessionStore::prepare() {
  if (is_prepared_) return std::nullopt;
  if (!journal_.is_there()) {
    if (auto error = begin_anew()) return error;
  }
  if (auto error = make_folder(folder_ / session_names::kImages)) return error;
  has_right_folder_ = false;
  if (!calibration_.empty()) {
    if (auto error = append(RecordedCalibration{calibration_})) return error;
  }
  for (const CalibrationFile& file : calibration_files(summary_.info.calibration)) {
    std::error_code ignored;  // then writing says why
    const fs::path path = folder_ / file.name;
    if (calibration_.empty() && fs::exists(path, ignored)) continue;
    const fs::path temporary = folder_ / session_names::kIncoming;
    if (auto error = write_file(path, temporary, as_bytes(file.text))) return error;
  }
  calibration_.clear();
  is_prepared_ = true;
  return std::nullopt;
}

/// The journal was removed. Its numbers go on, so that places from before are before.
std::optional<Error> SessionStore::begin_anew() {
  if (auto error = journal_.open({journal_.end().segment + 1, 0})) return error;
  summary_.totals = {};
  summary_.late_end = 0;
  numbers_.reset();
  times_.reset();
  samples_.clear();
  is_new_ = true;
  return std::nullopt;
}

/// On error the session is as before, but for a device that does not keep what was written.
std::optional<Error> SessionStore::append(const RecordBody& body) {
  if (sync_failed_) return sync_failed_;
  const auto place = journal_.append(type_of(body), {encode(body, kept_)});
  if (!place) {
    is_prepared_ = false;
    return place.error();
  }
  add(body, summary_);
  const auto* const frame = std::get_if<RecordedFrame>(&body);
  has_new_late_ = has_new_late_ || (frame != nullptr && frame->is_late);
  is_new_ = false;
  is_clean_ = is_clean_after(body, is_clean_);
  if (!is_synced_) return std::nullopt;
  sync_failed_ = journal_.sync();
  if (!sync_failed_) kept_ = journal_.end();
  return sync_failed_;
}

/// Of what is no frame: a frame finds out by itself that the folder was removed.
std::optional<Error> SessionStore::append_to_folder(const RecordBody& body) {
  is_prepared_ = is_prepared_ && journal_.is_there();
  auto error = prepare();
  return error ? error : append(body);
}

std::optional<Error> SessionStore::write_images(const EncodedFrame& frame, bool is_synced) {
  const fs::path incoming = folder_ / session_names::kIncoming;
  const fs::path incoming_right = folder_ / session_names::kIncomingRight;
  auto error = write_new(incoming, frame.left(), is_synced);
  if (!error && frame.is_stereo()) {
    if (!std::exchange(has_right_folder_, true)) {
      error = make_folder(folder_ / session_names::kRightImages);
    }
    if (!error) error = write_new(incoming_right, frame.right(), is_synced);
    if (!error && is_synced) error = sync(folder_);  // recovery may need it between the renames
  }
  if (!error) error = move_file(incoming, folder_ / session_names::left_image(frame.sequence));
  if (!error && frame.is_stereo()) {
    error = move_file(incoming_right, folder_ / session_names::right_image(frame.sequence));
  }
  if (!error && is_synced_) error = sync(folder_ / session_names::kImages);
  if (!error && is_synced_ && frame.is_stereo()) {
    error = sync(folder_ / session_names::kRightImages);
  }
  if (!error) return std::nullopt;
  ::unlink(incoming.c_str());
  ::unlink(incoming_right.c_str());
  is_prepared_ = false;
  return error;
}

void SessionStore::remove_images(Sequence sequence) const {
  ::unlink((folder_ / session_names::left_image(sequence)).c_str());
  ::unlink((folder_ / session_names::right_image(sequence)).c_str());
}

/// A frame that is not there yet.
std::optional<Error> SessionStore::accept(const EncodedFrame& frame, const RecordedFrame& record) {
  if (auto error = prepare()) return error;
  const auto before = journal_.end();
  auto error = write_images(frame, is_synced_);
  if (!error) error = append(record);
  if (error) {
    if (!sync_failed_) remove_images(frame.sequence);
    return error;
  }
  if (numbers_) numbers_->add(record);
  if (!record.is_late) append_line(record, before);
  return std::nullopt;
}

std::optional<Error> SessionStore::write(const EncodedFrame& frame, std::int64_t arrived_ns) {
  if (sync_failed_) return sync_failed_;
  if (frame.sequence < position()[wire::kFrames]) return std::nullopt;
  if (frame.sequence < summary_.late_end) {  // it may have come late already
    if (auto error = load_numbers()) return error;
    if (numbers_->there.contains(frame.sequence)) {
      return is_repeat(frame) ? std::nullopt : set_conflict_aside(frame);
    }
  }
  if (auto error = accept(frame, record_of(frame, arrived_ns))) return error;
  if (!std::exchange(is_size_compared_, true)) {  // a new calibration was pending before
    const auto problem = size_problem(summary_.info.calibration, frame.width_px, frame.height_px);
    if (!problem.empty()) log_warn("{}: {}", folder_.string(), problem);
  }
  return std::nullopt;
}

/// The line is a view: where it cannot be written the frame is accepted all the same.
void SessionStore::append_line(const RecordedFrame& frame, const journal::Place& place) {
  if (!times_) return mend_from(times_from_);
  const std::string line = session_lines::times(frame);
  const fs::path path = folder_ / session_names::kTimes;
  if (write_all_at(times_->fd.get(), times_->bytes, as_bytes(line), path)) return mend_from(place);
  times_->bytes += line.size();
}

/// The lines of records from `place` on may be missing.
void SessionStore::mend_from(const journal::Place& place) {
  times_.reset();
  times_from_ = place;
  auto times = mend_times(folder_, place);
  if (times) {
    times_ = std::move(times).value();
  } else if (lines_.lets_through()) {
    log_warn("times.txt is not complete for now: {}", times.error().text);
  }
}

std::optional<Error> SessionStore::write_items(const RecordedItems& items) {
  auto error = append_to_folder(items);
  if (error) return error;
  if (numbers_) numbers_->add(items);
  append_samples(items);
  return std::nullopt;
}

/// Like lines of times.txt, only a view.
void SessionStore::append_samples(const RecordedItems& items) {
  const auto& streams = summary_.info.streams;
  const auto stream = std::ranges::find(streams, items.stream, &wire::StreamDeclaration::id);
  if (stream == streams.end()) return;
  const fs::path path = folder_ / session_names::samples(*stream);
  UniqueFd& file = samples_[items.stream];
  std::optional<Error> error;
  if (file) {
    std::string lines;
    const auto samples = wire::parse_samples(stream->codec, items.payload);
    if (!samples) return;
    for (const Sample& sample : samples.value()) lines += to_line(sample);
    error = write_all(file.get(), as_bytes(lines), path);
  } else {
    const auto all = write_samples(folder_, *stream);
    if (!all) error = all.error();
    file = UniqueFd(::open(path.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC));
  }
  if (!error && file) return;
  file = UniqueFd();  // it is made again with the next ones
  if (lines_.lets_through()) log_warn("{} is not complete for now", path.string());
}

std::optional<Error> SessionStore::note(const RecordedReport& report) {
  if (!is_new_) return append_to_folder(report);
  add(report, summary_);
  return std::nullopt;
}

std::optional<Error> SessionStore::take_account(const wire::Account& account) {
  const auto now = std::chrono::steady_clock::now();
  const auto& known = summary_.account;
  const bool is_due = !known || known->is_final != account.is_final ||
                      known->has_ended != account.has_ended ||
                      known->is_held() != account.is_held() || !account.given_up.empty() ||
                      !account_at_ || now - *account_at_ >= kAccountInterval;
  auto before = known;
  if (before) before->session_id = account.session_id;
  if (!is_due || before == account) return std::nullopt;
  if (auto error = append_to_folder(account)) return error;
  account_at_ = now;
  return std::nullopt;
}

std::optional<Error> SessionStore::finish(bool has_ended) {
  if (is_new_) return std::nullopt;
  is_clean_ = false;
  ::unlink((folder_ / session_names::kSession).c_str());  // its absence says: views are to be made
  if (auto error = append_to_folder(RecordedEnd{has_ended})) return error;
  times_.reset();
  samples_.clear();
  times_from_ = journal_.end();
  if (const auto error = make_views(folder_, Views::kAll)) {
    is_clean_ = false;
    log_warn("{}: not all lists are made: {}", folder_.string(), error->text);
    return std::nullopt;
  }
  if (!summary_.is_held() && std::exchange(has_new_late_, false)) {
    log_info("{} {}: {} late frames have completed the session", summary_.info.robot_id,
             summary_.info.session_id, summary_.totals.late + summary_.totals.replaced);
  }
  return std::nullopt;
}

std::optional<Error> SessionStore::close() {
  if (is_new_ || is_clean_ || summary_.is_held()) return std::nullopt;
  return finish(summary_.closing.has_ended);
}

void SessionStore::Numbers::add(const RecordedFrame& frame) {
  there.insert(frame.sequence);
  if (frame.is_replacing) {
    const auto old = find(frame.sequence);
    if (old != reduced.end()) reduced.erase(old);
  } else if (!frame.is_late && frame.is_reduced()) {
    reduced.push_back(frame);
  }
}

void SessionStore::Numbers::add(const RecordedItems& added) {
  if (added.stream < wire::kFirstOther) return;
  SequenceSet& numbers = items[added.stream];
  for (std::uint64_t number = added.first; number < added.next; ++number) numbers.insert(number);
}

std::vector<RecordedFrame>::iterator SessionStore::Numbers::find(Sequence sequence) {
  const auto found = std::ranges::lower_bound(reduced, sequence, {}, &RecordedFrame::sequence);
  return found != reduced.end() && found->sequence == sequence ? found : reduced.end();
}

std::optional<Error> SessionStore::load_numbers() {
  if (numbers_) return std::nullopt;
  Numbers numbers;
  RecordReader reader(folder_);
  for (;;) {
    const auto entry = reader.next();
    if (!entry) return entry.error();
    if (!entry.value()) break;
    const RecordBody& body = entry.value()->record.body;
    if (const auto* const frame = std::get_if<RecordedFrame>(&body)) numbers.add(*frame);
    if (const auto* const items = std::get_if<RecordedItems>(&body)) numbers.add(*items);
  }
  numbers_ = std::move(numbers);
  return std::nullopt;
}

Result<SessionStore::Late> SessionStore::write_late(const EncodedFrame& frame,
                                                    std::int64_t arrived_ns) {
  if (sync_failed_) return *sync_failed_;
  if (auto error = load_numbers()) return std::move(*error);
  RecordedFrame record = record_of(frame, arrived_ns);
  record.is_late = true;
  if (!numbers_->there.contains(frame.sequence)) {
    if (auto error = accept(frame, record)) return std::move(*error);
    return Late::kNew;
  }
  const auto reduced = numbers_->find(frame.sequence);
  if (reduced != numbers_->reduced.end() && is_reduced_from(record, *reduced, frame.jpeg)) {
    record.is_replacing = true;
    record.replaced_bytes = reduced->bytes;
    if (auto error = replace(frame, record)) return std::move(*error);
    return Late::kReplaced;
  }
  if (is_repeat(frame)) return Late::kRepeat;
  if (auto error = set_conflict_aside(frame)) return std::move(*error);
  return Late::kConflict;
}

std::optional<Error> SessionStore::write_late(const wire::Items& items) {
  if (sync_failed_) return sync_failed_;
  const auto samples = wire::parse_samples(summary_.info.streams, items.stream, items.payload);
  if (!samples) return std::nullopt;
  if (auto error = load_numbers()) return error;
  const SequenceSet& there = numbers_->items[items.stream];
  const std::uint64_t end = items.first + samples.value().size();
  std::vector<RecordedItems> missing;
  for (auto first = there.next_out(items.first, end); first < end;) {
    const auto next = there.next_in(first, end);
    const auto some = std::span(samples.value())
                          .subspan(static_cast<std::size_t>(first - items.first),
                                   static_cast<std::size_t>(next - first));
    missing.push_back({items.stream, first, next, wire::encode_samples(some), true});
    first = there.next_out(next, end);
  }
  for (const RecordedItems& late : missing) {
    if (auto error = append_to_folder(late)) return error;
    if (numbers_) numbers_->add(late);
  }
  return std::nullopt;
}

/// The new images are on the device before they take the places of those that were acknowledged. If
/// the record is lost, is_whole() knows them, recovery completes a pair of which one was renamed,
/// and the robot sends them again.
std::optional<Error> SessionStore::replace(const EncodedFrame& frame, const RecordedFrame& record) {
  if (auto error = prepare()) return error;
  if (auto error = write_images(frame, true)) return error;
  if (auto error = append(record)) return error;
  numbers_->add(record);
  return std::nullopt;
}

bool SessionStore::has_stream(wire::StreamId stream) const {
  return std::ranges::count(summary_.info.streams, stream, &wire::StreamDeclaration::id) > 0;
}

bool SessionStore::has_images(const EncodedFrame& frame) const {
  return has_bytes(folder_ / session_names::left_image(frame.sequence), frame.left()) &&
         (!frame.is_stereo() ||
          has_bytes(folder_ / session_names::right_image(frame.sequence), frame.right()));
}

/// Of a frame that is there. One whose image is in a part only cannot be compared.
bool SessionStore::is_repeat(const EncodedFrame& frame) const {
  std::error_code failed;
  const bool is_removed =
      summary_.has_removed() &&
      !fs::exists(folder_ / session_names::left_image(frame.sequence), failed) && !failed;
  return is_removed || has_images(frame);
}

/// By its checksum, so that what comes again takes no more room.
std::optional<Error> SessionStore::set_conflict_aside(const EncodedFrame& frame) {
  const fs::path images = folder_ / session_names::kOrphans / session_names::kImages;
  if (auto error = make_folder(images)) return error;
  const auto name = fmt::format("{:06}.{:08X}.jpg", frame.sequence, crc32(frame.jpeg));
  if (conflicts_.lets_through()) {
    log_error("{}: frame {} came again with other bytes: what is there stays, and these are in {}",
              folder_.string(), frame.sequence, (images / name).string());
  }
  const fs::path temporary = folder_ / session_names::kIncoming;
  return write_file(images / name, temporary, frame.jpeg);
}

}  // namespace orbbuf
