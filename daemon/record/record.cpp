// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/record.hpp"

#include <stdexcept>
#include <system_error>

#include "common/quantity.hpp"

namespace orbbuf {
namespace {

using std::chrono::seconds;

constexpr seconds kSyncInterval{1};
constexpr seconds kRetryInterval{5};
constexpr int kMostReads = 12;  // of a frame; then it is taken for damaged
constexpr std::uint64_t kLittle = 64 << 10;
constexpr seconds kLogInterval{10};
constexpr seconds kEndLimit{8};  // with link.drain_timeout, the service has 30 s to end
constexpr std::size_t kEndSyncBytes = 2 << 20;
constexpr std::size_t kMostDescribed = 20;

std::uint64_t segment_bytes(const RecordSettings& settings) {
  constexpr std::uint64_t kSegments = 4;  // at least
  return settings.keeps_frames
             ? std::min(Record::kFrameSegmentBytes, settings.size_bytes / kSegments)
             : Record::kSegmentBytes;
}

}  // namespace

Record::Record(RecordSettings settings, const std::string& robot_id, const std::string& session_id,
               std::function<void()> changed)
    : settings_(std::move(settings)),
      name_(robot_id + '/' + session_id),
      changed_(std::move(changed)),
      segment_bytes_(segment_bytes(settings_)),
      folder_(settings_.path),
      pace_(settings_.rate_bytes_per_s),
      item_pace_(settings_.rate_bytes_per_s),
      state_(robot_id, session_id),
      refused_limit_(kLogInterval),
      damaged_limit_(kLogInterval),
      lost_limit_(kLogInterval) {
  const bool is_open = !settings_.path.empty() && open();
  state_.begin();
  settings_.keeps_frames = settings_.keeps_frames && is_open;
  if (!is_open) return;
  for (const auto& line : state_.describe_earlier(kMostDescribed)) log_warn("{}", line);
  if (const auto held = state_.held(); held > 0) {
    log_info("record: {} has {} frames, which are sent late", settings_.path.string(), held);
  }
  if (state_.held_items() > 0) {
    log_info("record: {} has samples, which are sent late", settings_.path.string());
  }
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

Record::~Record() = default;

/// False, and logged: nothing is written.
bool Record::open() {
  const auto locked = folder_.lock();
  auto read = locked ? Result<RecordFolder::End>(Error{locked->text}) : folder_.read(state_);
  if (!read) {
    if (locked && locked->is_taken) {
      throw std::runtime_error(read.error().text + "; change spool.path or buffer.drop_log");
    }
    log_warn("record: {}; the robot streams without {}: make it writable, and start orbbufd again",
             read.error().text, settings_.keeps_frames ? "spool and record" : "a record");
    return false;
  }
  RecordFolder::End& end = read.value();
  writer_.emplace(settings_.path, ~std::uint64_t{0}, true, [this] {
    const std::lock_guard lock(mutex_);
    return state_.checkpoint();
  });
  if (const auto error = writer_->open(end.place)) fail(*error);
  index_ = std::move(end.index);
  if (end.checkpoint_bytes > 0) segment_end_ = end.checkpoint_bytes + segment_bytes_;
  return true;
}

void Record::give_up(std::span<const DropRecord> records) {
  if (records.empty()) return;
  const std::lock_guard lock(mutex_);
  state_.give_up(records);
}

bool Record::keep(const wire::Items& items) {
  if (!keeps_items()) return false;
  const auto now = Clock::now();
  const std::size_t bytes = items.payload.size();
  const std::lock_guard lock(mutex_);
  if (now < item_pace_.next()) return false;
  if (state_.pending_item_bytes() + bytes > kMostPendingItemBytes) return false;
  item_pace_.spend(bytes, now);
  state_.keep(items);
  return true;
}

std::uint64_t Record::send_late(wire::StreamId stream, std::uint64_t begin, std::uint64_t end) {
  const std::lock_guard lock(mutex_);
  wake();
  return state_.send_late(stream, begin, end);
}

void Record::note(const SessionProgress& progress) {
  const std::lock_guard lock(mutex_);
  if (!state_.note(progress)) return;
  is_note_due_ = true;
  wake();
}

void Record::end() {
  const std::lock_guard lock(mutex_);
  state_.end();
  is_note_due_ = true;
  wake();
}

void Record::keep(FramePtr frame) {
  if (!settings_.keeps_frames) return;
  const std::size_t bytes = frame->jpeg.size();
  const std::lock_guard lock(mutex_);
  if (bytes > std::min<std::uint64_t>(settings_.size_bytes, journal::kMostBodyBytes) / 2) {
    return refuse("it is larger than half of spool.size, or than 32 MiB");
  }
  if (pending_bytes_ + bytes > kMostPendingBytes) {
    return refuse(is_failing_ ? "the disk fails" : "the disk, or spool.rate, is too slow");
  }
  if (!state_.keep(frame->sequence)) return;
  pending_bytes_ += bytes;
  pending_.push_back(std::move(frame));
  wake();
}

void Record::refuse(const std::string& why) {
  ++counts_.not_kept;
  if (!refused_limit_.lets_through()) return;
  log_warn("record: a frame is not kept: {}; {} since the start", why, counts_.not_kept);
}

void Record::release(Sequence sequence) {
  const std::lock_guard lock(mutex_);
  const auto id = state_.find_present(sequence);
  if (!id) return;
  state_.remove(*id);
  const auto pending = std::ranges::find(pending_, sequence, &EncodedFrame::sequence);
  if (pending != pending_.end() && pending != pending_.begin()) {  // that may be being written
    pending_bytes_ -= (*pending)->jpeg.size();
    pending_.erase(pending);
  }
  wake();
}

void Record::set_live_from(Sequence end) {
  const std::lock_guard lock(mutex_);
  if (std::exchange(live_from_, end) < end) wake();
}

std::optional<Record::LateFrame> Record::next() {
  const std::lock_guard lock(mutex_);
  while (!ready_.empty() && !state_.is_held(ready_.front().id)) ready_.pop_front();
  return ready_.empty() ? std::nullopt : std::optional(ready_.front());
}

void Record::take_next() {
  const std::lock_guard lock(mutex_);
  taken_.push_back(ready_.front().id);
  ready_.pop_front();
  wake();
}

void Record::remove(const KeptId& id) {
  const std::lock_guard lock(mutex_);
  std::erase(taken_, id);
  state_.remove(id);
  wake();
}

std::vector<wire::Account> Record::take_accounts() {
  const std::lock_guard lock(mutex_);
  return state_.take_accounts();
}

void Record::settle(const std::string& session_id) {
  const std::lock_guard lock(mutex_);
  if (!state_.settle(session_id)) return;
  log_info("record: the server knows what became of session {}", session_id);
}

void Record::rewind() {
  const std::lock_guard lock(mutex_);
  for (const LateFrame& ready : ready_) state_.give_back(ready.id);
  for (const KeptId& id : taken_) state_.give_back(id);
  ready_.clear();
  taken_.clear();
  ++rewinds_;
  state_.rewind_accounts();
  wake();
}

Record::Stats Record::stats() const {
  const std::lock_guard lock(mutex_);
  Stats stats = counts_;
  stats.held = state_.held();
  stats.bytes = state_.bytes() + pending_bytes_;
  return stats;
}

void Record::wake() {
  is_woken_ = true;
  woken_.notify_one();
}

void Record::run(const std::stop_token& stop) {
  name_this_thread("record");
  Lock lock(mutex_);
  while (!stop.stop_requested()) {
    const auto now = Clock::now();
    if (work(lock, now)) {
      if (!std::exchange(is_changed_, false)) continue;
      lock.unlock();
      changed_();
      lock.lock();
      continue;
    }
    const auto is_woken = [this] { return std::exchange(is_woken_, false); };
    const auto deadline = next_deadline(now);
    if (deadline == Clock::time_point::max()) {
      woken_.wait(lock, stop, is_woken);
    } else {
      woken_.wait_until(lock, stop, deadline, is_woken);
    }
  }
  finish(lock);
}

/// Does one thing, the most urgent first; false if there is nothing to do at `now`.
bool Record::work(Lock& lock, Clock::time_point now) {
  const bool is_sync_late = now >= sync_at_ && now - sync_at_ > kSyncInterval;
  return write_notes(lock, now) || read_ahead(lock, now) || (is_sync_late && sync(lock, now)) ||
         write_frame(lock, now) || sync(lock, now) || remove_oldest(lock);
}

Record::Clock::time_point Record::next_deadline(Clock::time_point now) const {
  auto deadline = sync_at_;
  if (is_note_due_ || !notes_.empty()) deadline = std::min(deadline, retry_at_);
  if (!pending_.empty()) deadline = std::min(deadline, std::max(pace_.next(), retry_at_));
  if (read_at_ > now) deadline = std::min(deadline, read_at_);
  return std::max(deadline, now);
}

bool Record::write_notes(Lock& lock, Clock::time_point now) {
  if (now < retry_at_ || (!is_note_due_ && notes_.empty())) return false;
  if (notes_.empty()) {
    is_note_due_ = false;
    notes_ = state_.take_notes();
  }
  lock.unlock();
  check_folder();
  std::optional<Error> failed;
  for (; !failed && !notes_.empty(); notes_.pop_front()) {
    const RecordState::Note& note = notes_.front();
    make_room(note.body.size());
    if (note.items && !has_room_for(note)) continue;
    const auto place = append(note.type, note.body, {});
    if (!place) failed = place.error();
    if (failed) break;
    if (note.items) {
      on_items_written(note, place.value());
      pace_.spend(note.body.size(), now);
    }
    auto& released = index_[note.session].released;
    released.insert(released.end(), note.released.begin(), note.released.end());
  }
  if (failed) {
    fail(*failed);
    make_room_for(notes_.front().body.size());
  }
  sync_at_ = std::min(sync_at_, now);
  lock.lock();
  return true;
}

/// Else they are not kept.
bool Record::has_room_for(const RecordState::Note& items) {
  if (has_free(journal::kHeadBytes + items.body.size() + settings_.least_free_bytes)) return true;
  const std::lock_guard lock(mutex_);
  state_.refuse_items(items);
  if (refused_limit_.lets_through()) {
    log_warn("record: samples are not kept: the disk is full; they wait in memory only");
  }
  return false;
}

void Record::on_items_written(const RecordState::Note& note, const journal::Place& place) {
  const KeptFrame written{note.first,
                          place.segment,
                          static_cast<std::uint32_t>(place.offset),
                          static_cast<std::uint32_t>(journal::kHeadBytes + note.body.size()),
                          KeptFrame::State::kWritten,
                          false,
                          note.count};
  index_[note.session].items.emplace_back(*note.items, written);
  const std::lock_guard lock(mutex_);
  state_.on_written(written, *note.items);
}

/// It could not be written. If the disk is full, the oldest frames pay.
void Record::make_room_for(std::size_t note_bytes) {
  Lock lock(mutex_);
  const auto checkpoint_bytes = state_.checkpoint().size();  // of a new segment
  if (has_free(note_bytes + checkpoint_bytes + record_format::encode(index_).size() + kLittle)) {
    return;
  }
  const auto oldest = state_.oldest_segment();
  if (!oldest || *oldest >= synced_segment_) return;
  lock.unlock();
  remove_segment(*oldest, "the disk is full");
}

/// True, too, if the system does not say.
bool Record::has_free(std::uint64_t bytes) const {
  std::error_code unknown;
  const auto space = std::filesystem::space(settings_.path, unknown);
  return unknown || space.available >= bytes;
}

/// Other programs may have removed files.
void Record::check_folder() {
  if (writer_->is_there()) return;
  log_error("record: the files in {} were removed; it makes new ones", settings_.path.string());
  if (const auto error = folder_.lock()) return fail(*error);
  begin_segment_next();
  Lock lock(mutex_);
  for (const std::uint32_t segment : state_.segments()) {
    std::error_code unknown;
    const auto file = journal::segment_path(settings_.path, segment);
    if (std::filesystem::exists(file, unknown) || unknown) continue;
    report_lost(state_.remove_segment(segment), "their files were removed");
  }
}

bool Record::write_frame(Lock& lock, Clock::time_point now) {
  while (!pending_.empty() && !state_.find_present(pending_.front()->sequence)) pop_pending();
  if (pending_.empty() || now < std::max(pace_.next(), retry_at_)) return false;
  const FramePtr frame = pending_.front();
  lock.unlock();
  const auto head = record_format::frame_head(name_, *frame);
  const std::uint64_t bytes = journal::kHeadBytes + head.size() + frame->jpeg.size();
  make_room(bytes);
  if (!has_free(bytes + settings_.least_free_bytes)) {
    // So that it can be removed when its frames are sent.
    segment_end_ = std::min(segment_end_, kSegmentBytes);
    lock.lock();
    refuse_pending("the disk is full");
    return true;
  }
  const auto place = append(record_format::kFrame, head, frame->jpeg);
  if (!place) fail(place.error());
  sync_at_ = std::min(sync_at_, now + kSyncInterval);
  pace_.spend(bytes, now);
  lock.lock();
  if (!place) return true;
  const KeptFrame written{frame->sequence, place.value().segment,
                          static_cast<std::uint32_t>(place.value().offset),
                          static_cast<std::uint32_t>(bytes), KeptFrame::State::kWritten};
  index_[name_].kept.push_back(written);
  state_.on_written(written);
  pop_pending();
  return true;
}

void Record::refuse_pending(const std::string& why) {
  if (const auto id = state_.find_present(pending_.front()->sequence)) {
    state_.remove(*id);
    refuse(why);
    is_changed_ = true;
  }
  pop_pending();
}

void Record::pop_pending() {
  pending_bytes_ -= pending_.front()->jpeg.size();
  pending_.pop_front();
}

Result<journal::Place> Record::append(std::uint8_t type, record_format::Bytes head,
                                      record_format::Bytes rest) {
  if (segment_end_ > 0 && writer_->end().offset >= segment_end_) {
    auto index = writer_->append(record_format::kIndex, {record_format::encode(index_)});
    if (!index) return index;
    begin_segment_next();
  }
  auto place = writer_->append(type, {head, rest});
  if (!place) return place;
  if (segment_end_ == 0) segment_end_ = place.value().offset + segment_bytes_;
  const std::lock_guard lock(mutex_);
  state_.add_segment(place.value().segment, writer_->end().offset);
  return place;
}

void Record::begin_segment_next() {
  writer_->end_segment();
  index_.clear();
  segment_end_ = 0;
}

/// Removes segments until so many more bytes fit, or only the one that is written is left.
void Record::make_room(std::uint64_t bytes) {
  for (;;) {
    Lock lock(mutex_);
    const auto oldest = state_.oldest_segment();
    if (!oldest || state_.bytes() + bytes <= settings_.size_bytes) return;
    lock.unlock();
    if (*oldest >= synced_segment_ && !sync_files()) return;
    remove_segment(*oldest, settings_.keeps_frames ? "spool.size is reached"
                                                   : "the record is as large as it may be");
  }
}

void Record::remove_segment(std::uint32_t segment, const std::string& why) {
  {
    const std::lock_guard lock(mutex_);
    report_lost(state_.remove_segment(segment), why);
  }
  if (const auto error = writer_->remove(segment)) log_warn("record: {}", error->text);
}

/// Not before the device has the accounts in two newer ones: one of them may be damaged.
bool Record::remove_oldest(Lock& lock) {
  const auto oldest = state_.oldest_segment();
  if (!oldest || state_.is_needed(*oldest) || *oldest + 1 >= synced_segment_) return false;
  lock.unlock();
  remove_segment(*oldest, "");  // none are
  lock.lock();
  return true;
}

bool Record::sync(Lock& lock, Clock::time_point now) {
  if (now < sync_at_) return false;
  lock.unlock();
  sync_at_ = Clock::time_point::max();
  const bool is_good = sync_files() && now >= retry_at_;
  lock.lock();
  if (is_good && std::exchange(is_failing_, false)) {
    log_info("record: {} takes records again", settings_.path.string());
  }
  return true;
}

/// After an error the segment's last records may be lost, and another sync would not say so: the
/// next one begins with a checkpoint.
bool Record::sync_files() {
  if (const auto error = writer_->sync()) {
    begin_segment_next();
    fail(*error);
    return false;
  }
  if (segment_end_ == 0) return false;
  synced_segment_ = writer_->end().segment;
  return true;
}

bool Record::read_ahead(Lock& lock, Clock::time_point now) {
  if (ready_.size() >= kReadAhead || now < read_at_) return false;
  const auto taken = state_.take_next(live_from_);
  if (!taken) return false;
  const auto rewinds = rewinds_;
  lock.unlock();
  const auto late = read(*taken);
  lock.lock();
  if (!late) read_at_ = now + kRetryInterval;  // no descriptors, perhaps
  if (!late && ++failed_reads_ < kMostReads) {
    state_.give_back(taken->id);
    if (damaged_limit_.lets_through()) {
      log_warn("record: {}; it is tried again every {} s", late.error().text,
               kRetryInterval.count());
    }
    return true;
  }
  if (late) failed_reads_ = 0;  // else those behind it are not tried as often
  if (!late || !late.value()) {
    ++counts_.damaged;
    state_.remove(taken->id);
    is_changed_ = true;
    if (!late || damaged_limit_.lets_through()) {
      log_warn("record: {} {} in {} {}; {} since the start",
               taken->id.stream == wire::kFrames ? "frame" : "samples from", taken->place.sequence,
               journal::segment_path(settings_.path, taken->place.segment).string(),
               late ? "is damaged" : "cannot be read: " + late.error().text, counts_.damaged);
    }
  } else if (rewinds != rewinds_) {
    state_.give_back(taken->id);
  } else if (state_.is_held(taken->id)) {
    if (ready_.empty()) is_changed_ = true;
    ready_.push_back(*late.value());
  }
  return true;
}

/// Nothing: it is damaged.
Result<std::optional<Record::LateFrame>> Record::read(const RecordState::Taken& taken) const {
  LateFrame late{taken.id, taken.session, nullptr};
  if (taken.id.stream == wire::kFrames) {
    auto frame = folder_.read_frame(taken.place);
    if (!frame) return std::move(frame).error();
    late.frame = std::move(frame).value();
    if (!late.frame) return std::nullopt;
  } else {
    auto items = folder_.read_items(taken.place);
    if (!items) return std::move(items).error();
    if (!items.value()) return std::nullopt;
    late.items = std::move(*items.value());
  }
  return late;
}

void Record::report_lost(const std::vector<RecordState::Lost>& lost, const std::string& why) {
  for (const auto& [session, frames, items] : lost) {
    counts_.evicted += frames;
    is_changed_ = true;
    if (!lost_limit_.lets_through()) continue;
    log_warn("record: {} kept frames{} of session {} are lost, since {}; {} since the start",
             frames, items > 0 ? " and samples" : "", session, why, counts_.evicted);
  }
}

/// Writing stops for a while.
void Record::fail(const Error& error) {
  retry_at_ = Clock::now() + kRetryInterval;
  const std::lock_guard lock(mutex_);
  if (std::exchange(is_failing_, true)) return;
  log_error("record: {}; it tries again every {} s, and up to {} of frames wait in memory",
            error.text, kRetryInterval.count(), format_bytes(kMostPendingBytes));
}

void Record::finish(Lock& lock) {
  const auto begin = Clock::now();
  retry_at_ = begin;
  is_note_due_ = true;
  std::size_t unsynced_bytes = kEndSyncBytes;  // and what was written before
  while (retry_at_ == begin && write_notes(lock, begin)) {
  }
  while (!pending_.empty() && retry_at_ == begin && Clock::now() < begin + kEndLimit) {
    if (unsynced_bytes >= kEndSyncBytes) {  // or a slow disk would delay the end unnoticed
      lock.unlock();
      sync_files();
      lock.lock();
      unsynced_bytes = 0;
      continue;
    }
    unsynced_bytes += pending_.front()->jpeg.size();
    write_frame(lock, std::max(pace_.next(), begin));
  }
  if (!pending_.empty()) {
    log_error("record: at the end {} frames are not kept: the disk fails or is too slow",
              pending_.size());
  }
  lock.unlock();
  sync_files();
  lock.lock();
}

}  // namespace orbbuf
