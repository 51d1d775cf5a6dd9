// SPDX-License-Identifier: Apache-2.0
#include "daemon/spool/spool.hpp"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>

#include "common/log.hpp"
#include "common/quantity.hpp"

namespace orbbuf {
namespace {

using std::chrono::seconds;

constexpr std::uint64_t kMinSegmentBytes = 1 << 20;
constexpr std::uint64_t kMaxSegmentBytes = 64 << 20;
constexpr std::uint64_t kSegments = 64;
constexpr seconds kSyncInterval{1};
constexpr seconds kCursorInterval{1};
constexpr seconds kRetryInterval{5};
constexpr seconds kLogInterval{10};
constexpr seconds kEndLimit{8};  // with link.drain_timeout, the service has 30 s to end
constexpr std::size_t kEndSyncBytes = 2 << 20;

std::uint64_t record_bytes(const EncodedFrame& frame) {
  return kRecordHeadBytes + frame.jpeg.size();
}

}  // namespace

Spool::Spool(SpoolSettings settings, std::string robot_id, std::string session_id,
             std::function<void()> changed)
    : settings_(std::move(settings)),
      robot_id_(std::move(robot_id)),
      session_id_(std::move(session_id)),
      changed_(std::move(changed)),
      segment_bytes_(
          std::clamp(settings_.size_bytes / kSegments, kMinSegmentBytes, kMaxSegmentBytes)),
      folder_(settings_.path, robot_id_),
      pace_(settings_.rate_bytes_per_s),
      queue_(session_id_),
      refused_limit_(kLogInterval),
      damaged_limit_(kLogInterval),
      lost_limit_(kLogInterval) {
  find_segments();
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

Spool::~Spool() = default;

void Spool::find_segments() {
  written_cursor_ = folder_.read_cursor().value_or(SpoolCursor{});
  next_number_ = written_cursor_.number + 1;
  std::size_t foreign = 0;
  for (const std::uint64_t number : folder_.segments()) {
    next_number_ = std::max(next_number_, number + 1);
    if (!find_segment(number, written_cursor_)) ++foreign;
  }
  if (foreign > 0) {
    spdlog::warn(
        "spool: {} segments in {} are not of robot {}; their frames are not sent, and they are "
        "removed when the spool is full",
        foreign, folder_.path().string(), robot_id_);
  }
  Lock lock(mutex_);
  while (load_index(lock)) {
  }
  while (queue_.sessions() >= kMostSessions) {  // one more for the present session
    const auto evicted = queue_.evict_frames();
    report_lost(evicted->lost);
    folder_.remove(evicted->number);
  }
  lock.unlock();
  make_room(0);
  lock.lock();
  while (remove_finished(lock)) {
  }
  is_changed_ = false;
  if (const std::size_t sessions = queue_.sessions(); sessions > 0) {
    spdlog::info("spool: {} holds {} frames of {} sessions", folder_.path().string(),
                 queue_.frames(), sessions);
  }
}

/// False if nothing in it is this robot's.
bool Spool::find_segment(std::uint64_t number, const SpoolCursor& cursor) {
  const auto file = folder_.segment(number);
  auto reader = SegmentReader::open(file);
  const bool is_ours = reader && reader.value().header().robot_id == robot_id_ &&
                       reader.value().header().number == number;
  if (!is_ours) {
    std::error_code failed;
    const auto bytes = std::filesystem::file_size(file, failed);
    if (!failed && bytes > 0) {
      if (!reader) spdlog::warn("spool: {}", reader.error().text);
      queue_.add_foreign(number, bytes);
      return false;
    }
    folder_.remove(number);  // a power cut left no more of it
    return true;
  }
  if (number < cursor.number) {
    folder_.remove(number);
    return true;
  }
  SegmentReader& segment = reader.value();
  auto range = segment.footer();
  if (!range) {
    const auto records = segment.scan();
    range.emplace();
    for (const SegmentRecord& record : records) range->add(record.sequence);
    if (const auto failed = segment.complete(records)) spdlog::warn("spool: {}", failed->text);
  }
  const std::uint64_t freed_below = number == cursor.number ? cursor.offset : 0;
  queue_.add_complete(segment.header(), segment.bytes(), *range, freed_below);
  return true;
}

void Spool::add(FramePtr frame) {
  const std::uint64_t bytes = record_bytes(*frame);
  const std::lock_guard lock(mutex_);
  if (bytes > settings_.size_bytes / 2) return refuse("is larger than half of spool.size");
  if (pending_bytes_ + frame->jpeg.size() > kMostPendingBytes) {
    return refuse(is_failing_ ? "the disk fails" : "the disk, or spool.rate, is too slow");
  }
  pending_bytes_ += frame->jpeg.size();
  pending_.push_back(std::move(frame));
  wake();
}

void Spool::refuse(const std::string& why) {
  ++counts_.not_spooled;
  if (!refused_limit_.lets_through()) return;
  spdlog::warn("spool: a frame is not spooled: {}; {} since the start", why, counts_.not_spooled);
}

void Spool::forget(Sequence sequence) {
  const std::lock_guard lock(mutex_);
  const auto found = std::find_if(pending_.begin(), pending_.end(), [&](const FramePtr& frame) {
    return frame->sequence == sequence;
  });
  if (found == pending_.end()) {
    queue_.forget(sequence);
  } else if (is_writing_ && found == pending_.begin()) {
    is_write_forgotten_ = true;
  } else {
    pending_bytes_ -= (*found)->jpeg.size();
    pending_.erase(found);
  }
  wake();
}

std::optional<SpooledFrame> Spool::next() {
  const std::lock_guard lock(mutex_);
  auto frame = queue_.next();
  if (frame) wake();
  return frame;
}

void Spool::acknowledge(std::uint64_t frames) {
  const std::lock_guard lock(mutex_);
  queue_.acknowledge(frames);
  wake();
}

void Spool::rewind() {
  const std::lock_guard lock(mutex_);
  for (const auto& lost : queue_.rewind()) report_lost(lost);
  wake();
}

std::vector<Spool::Held> Spool::held() const {
  const std::lock_guard lock(mutex_);
  std::vector<Held> held;
  for (const auto& [session_id, range] : queue_.held()) {
    held.push_back({session_id, range.frames, range.first});
  }
  FrameRange waiting;
  for (const FramePtr& frame : pending_) {
    const bool is_forgotten = is_write_forgotten_ && frame == pending_.front();
    if (!is_forgotten) waiting.add(frame->sequence);
  }
  if (waiting.frames == 0) return held;
  if (held.empty() || held.back().session_id != session_id_) {
    held.push_back({session_id_, 0, waiting.first});
  }
  held.back().frames += waiting.frames;
  held.back().first = std::min(held.back().first, waiting.first);
  return held;
}

Spool::Stats Spool::stats() const {
  std::uint64_t frames = 0;
  for (const Held& session : held()) frames += session.frames;
  const std::lock_guard lock(mutex_);
  Stats stats = counts_;
  stats.frames = frames;
  stats.bytes = queue_.bytes() + pending_bytes_;
  return stats;
}

void Spool::wake() {
  is_woken_ = true;
  woken_.notify_one();
}

void Spool::run(const std::stop_token& stop) {
  name_this_thread("spool");
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
bool Spool::work(Lock& lock, Clock::time_point now) {
  return remove_finished(lock) || write_cursor(lock, now) || sync(lock, now) || load_index(lock) ||
         read_ahead(lock) || write_pending(lock, now);
}

Spool::Clock::time_point Spool::next_deadline(Clock::time_point now) const {
  auto deadline = sync_at_;
  if (queue_.cursor() != written_cursor_) deadline = std::min(deadline, cursor_at_);
  if (!pending_.empty()) deadline = std::min(deadline, std::max(pace_.next(), retry_at_));
  return std::max(deadline, now);
}

bool Spool::remove_finished(Lock& lock) {
  const auto number = queue_.take_finished();
  if (!number) return false;
  lock.unlock();
  remove(*number);
  lock.lock();
  return true;
}

bool Spool::load_index(Lock& lock) {
  const auto number = queue_.to_load();
  if (!number) return false;
  lock.unlock();
  reader_.reset();  // it may have been opened when the segment was shorter
  const SegmentReader* const segment = reader(*number);
  const auto records = segment == nullptr ? std::vector<SegmentRecord>() : segment->scan();
  lock.lock();
  const std::uint64_t missing = queue_.load(*number, records);
  if (missing > 0)
    report_damaged(missing, "cannot find them in " + folder_.segment(*number).string());
  is_changed_ = true;
  return true;
}

bool Spool::read_ahead(Lock& lock) {
  if (queue_.ready() >= kReadAhead) return false;
  const auto place = queue_.to_read();
  if (!place) return queue_.to_load().has_value();
  lock.unlock();
  const SegmentReader* const segment = reader(place->number);
  FramePtr frame;
  std::string why;
  if (segment != nullptr) {
    auto read = segment->read(place->record);
    if (read) frame = std::move(read.value());
    if (!read) why = read.error().text;
  }
  lock.lock();
  if (queue_.ready() == 0) is_changed_ = true;
  if (!queue_.put(*place, std::move(frame))) {
    report_damaged(1, why);
    is_changed_ = true;
  }
  return true;
}

/// The open segment, kept for the next call; null if it cannot be opened, which is logged.
const SegmentReader* Spool::reader(std::uint64_t number) {
  if (reader_ && reader_->header().number == number) return &*reader_;
  reader_.reset();
  auto opened = SegmentReader::open(folder_.segment(number));
  if (opened) return &reader_.emplace(std::move(opened.value()));
  spdlog::warn("spool: {}", opened.error().text);
  return nullptr;
}

void Spool::remove(std::uint64_t number) {
  if (reader_ && reader_->header().number == number) reader_.reset();  // or it keeps its room
  folder_.remove(number);
}

bool Spool::write_cursor(Lock& lock, Clock::time_point now) {
  const SpoolCursor cursor = queue_.cursor();
  if (cursor == written_cursor_ || now < cursor_at_) return false;
  lock.unlock();
  const auto failed = folder_.write_cursor(cursor);
  if (failed) fail(*failed);
  if (!failed) written_cursor_ = cursor;
  cursor_at_ = now + (failed ? kRetryInterval : kCursorInterval);
  sync_at_ = std::min(sync_at_, now + kSyncInterval);
  lock.lock();
  return true;
}

bool Spool::sync(Lock& lock, Clock::time_point now) {
  if (now < sync_at_) return false;
  lock.unlock();
  sync_at_ = Clock::time_point::max();
  const auto failed = writer_ ? writer_->sync() : std::nullopt;
  if (failed) {
    fail(*failed);
    end_segment();  // what the device did not take must not be taken for written
  }
  if (const auto also_failed = folder_.sync()) fail(*also_failed);
  lock.lock();
  return true;
}

bool Spool::write_pending(Lock& lock, Clock::time_point now) {
  if (pending_.empty() || now < std::max(pace_.next(), retry_at_)) return false;
  const FramePtr frame = pending_.front();
  is_writing_ = true;
  lock.unlock();
  const auto record = write(*frame);
  if (!record) fail(record.error());
  pace_.spend(record_bytes(*frame), now);
  sync_at_ = std::min(sync_at_, now + kSyncInterval);
  lock.lock();
  is_writing_ = false;
  const bool is_forgotten = std::exchange(is_write_forgotten_, false);
  if (record && std::exchange(is_failing_, false)) {
    spdlog::info("spool: {} takes frames again", folder_.path().string());
  }
  if (record) queue_.add_record(record.value(), is_forgotten);
  if (!record && !is_forgotten) return true;
  pending_bytes_ -= frame->jpeg.size();
  pending_.pop_front();
  return true;
}

Result<SegmentRecord> Spool::write(const EncodedFrame& frame) {
  const std::uint64_t bytes = record_bytes(frame);
  if (writer_ && writer_->bytes() + bytes > segment_bytes_) end_segment();
  if (!writer_) {
    if (const auto failed = begin_segment(bytes)) return *failed;
  }
  auto record = writer_->append(frame);
  if (!record && writer_->is_broken()) end_segment();
  return record;
}

std::optional<Error> Spool::begin_segment(std::uint64_t record_bytes) {
  constexpr std::uint64_t kOtherBytes = 1024;  // header and footer
  make_room(std::max(segment_bytes_, record_bytes + kOtherBytes));
  auto made =
      SegmentWriter::create(folder_.segment(next_number_), {robot_id_, session_id_, next_number_});
  if (!made) return made.error();
  writer_.emplace(std::move(made.value()));
  {
    const std::lock_guard lock(mutex_);
    queue_.begin(next_number_++, writer_->bytes());
  }
  return folder_.sync();
}

void Spool::end_segment() {
  if (!writer_) return;
  const auto failed = writer_->complete();
  if (failed) spdlog::warn("spool: {}", failed->text);
  const std::lock_guard lock(mutex_);
  queue_.complete(writer_->bytes());
  writer_.reset();
}

/// Evicts until so many more bytes fit, or nothing is left to evict.
void Spool::make_room(std::uint64_t bytes) {
  Lock lock(mutex_);
  while (queue_.bytes() + bytes > settings_.size_bytes) {
    const auto evicted = queue_.evict();
    if (!evicted) return;
    report_lost(evicted->lost);
    is_changed_ = true;
    lock.unlock();
    remove(evicted->number);
    lock.lock();
  }
}

void Spool::report_lost(const SegmentQueue::Lost& lost) {
  if (lost.range.frames == 0) return;
  counts_.evicted += lost.range.frames;
  if (lost.session_id != lost_.session_id) log_lost();
  lost_.session_id = lost.session_id;
  lost_.range.add(lost.range);
  if (lost_limit_.lets_through()) log_lost();
}

void Spool::log_lost() {
  if (lost_.range.frames == 0) return;
  spdlog::warn("spool: full: frames {} to {} of session {} are lost ({} frames)", lost_.range.first,
               lost_.range.last, lost_.session_id, lost_.range.frames);
  lost_.range = {};
}

void Spool::report_damaged(std::uint64_t frames, const std::string& why) {
  counts_.damaged += frames;
  if (!damaged_limit_.lets_through()) return;
  spdlog::warn("spool: {} frames are damaged: {}; {} since the start", frames, why,
               counts_.damaged);
}

/// Writing stops for a while.
void Spool::fail(const Error& error) {
  retry_at_ = Clock::now() + kRetryInterval;
  const std::lock_guard lock(mutex_);
  if (std::exchange(is_failing_, true)) return;
  spdlog::error("spool: {}; it tries again every {} s, and up to {} of frames wait in memory",
                error.text, kRetryInterval.count(), format_bytes(kMostPendingBytes));
}

void Spool::finish(Lock& lock) {
  const auto begin = Clock::now();
  retry_at_ = begin;
  std::size_t unsynced_bytes = kEndSyncBytes;  // and what was written before
  while (!pending_.empty() && retry_at_ == begin && Clock::now() < begin + kEndLimit) {
    if (unsynced_bytes >= kEndSyncBytes) {  // or a slow disk would delay the end unnoticed
      sync_at_ = begin;
      sync(lock, begin);
      unsynced_bytes = 0;
      continue;
    }
    unsynced_bytes += pending_.front()->jpeg.size();
    write_pending(lock, std::max(pace_.next(), begin));
  }
  counts_.not_spooled += pending_.size();
  if (!pending_.empty()) {
    spdlog::error("spool: at the end {} frames are not spooled: the disk fails or is too slow",
                  pending_.size());
  }
  log_lost();
  lock.unlock();
  end_segment();
  lock.lock();
  while (remove_finished(lock)) {
  }
  cursor_at_ = sync_at_ = Clock::now();
  write_cursor(lock, cursor_at_);
  sync(lock, Clock::now());
}

}  // namespace orbbuf
