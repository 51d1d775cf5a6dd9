// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/backfill.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <span>
#include <utility>

namespace orbbuf {

Backfill::Backfill(boost::asio::io_context& io, Spool& spool, FrameBuffer& buffer,
                   std::string session_id, std::function<void()> wake)
    : spool_(spool),
      buffer_(buffer),
      session_id_(std::move(session_id)),
      wake_(std::move(wake)),
      timer_(io) {
  buffer_.keep_for_spool();
}

void Backfill::collect(bool those_at_risk) {
  buffer_.collect_for_spool(collected_, those_at_risk);
  for (FramePtr& frame : collected_.frames) spool_.add(std::move(frame));
  for (const Sequence sequence : collected_.acknowledged) {
    spool_.forget(sequence);
    const bool is_next =
        next_ && next_->session_id == session_id_ && next_->frame->sequence == sequence;
    if (is_next) pass_over();
  }
}

void Backfill::on_connected(bool takes_late, std::uint32_t max_frame_bytes) {
  begin_connection();
  takes_late_ = takes_late;
  max_frame_bytes_ = max_frame_bytes;
  if (takes_late) return;
  spdlog::warn(
      "link: the server takes no late frames: it is older, or its files.enabled is false; the "
      "spool keeps them");
}

void Backfill::on_disconnected() { begin_connection(); }

void Backfill::begin_connection() {
  takes_late_ = false;
  next_.reset();
  record_.clear();
  sent_ = 0;
  next_number_ = acknowledged_ = 0;
  begun_.clear();
  begun_bytes_ = 0;
  said_.reset();
  spool_.rewind();
}

void Backfill::on_late_ack(std::uint64_t next) {
  if (next > next_number_) return;  // not of anything that was sent
  acknowledge(next - std::min(next, acknowledged_));
  acknowledged_ = std::max(acknowledged_, next);
  wake_();
}

/// The oldest ones, and those that were passed over between and behind them.
void Backfill::acknowledge(std::uint64_t sent) {
  std::uint64_t frames = 0;
  while (!begun_.empty() && (sent > 0 || !begun_.front().is_sent)) {
    if (begun_.front().is_sent) --sent;
    begun_bytes_ -= begun_.front().bytes;
    begun_.pop_front();
    ++frames;
  }
  if (frames > 0) spool_.acknowledge(frames);
}

std::vector<std::uint8_t> Backfill::take_spool_message(Time now, bool final) {
  if (!takes_late_ || (said_ && !final && now - said_time_ < kSpoolInterval)) return {};
  wire::Spool spool;
  for (const Spool::Held& held : spool_.held()) {
    spool.sessions.push_back({held.session_id, held.frames, held.first});
  }
  said_time_ = now;
  if (said_ == spool && !final) return {};
  said_ = std::move(spool);
  return wire::encode(*said_);
}

std::vector<std::uint8_t> Backfill::take_part(Time now, double bytes_per_s, Time busy_until) {
  if (!takes_late_ || (record_.empty() && !begin_frame())) return {};
  const auto turn = pace_.next(now, bytes_per_s, busy_until);
  if (turn.bytes == 0) {
    wake_at(turn.again);
    return {};
  }
  const auto rest = std::span(record_).subspan(sent_);
  const auto bytes = rest.first(std::min(turn.bytes, rest.size()));
  auto message = wire::encode(wire::LatePart{next_number_, static_cast<std::uint32_t>(sent_),
                                             static_cast<std::uint32_t>(record_.size()), bytes});
  sent_ += bytes.size();
  if (sent_ == record_.size()) {
    record_.clear();
    ++next_number_;
  }
  return message;
}

/// False if there is none to be sent now.
bool Backfill::begin_frame() {
  constexpr std::size_t kLeast = 2;
  if (begun_.size() >= kLeast && begun_bytes_ >= kMostUnacknowledged) return false;
  while (next_ || (next_ = spool_.next())) {
    const EncodedFrame& frame = *next_->frame;
    // It may still wait for the live stream, or be on its way there.
    const bool is_present = next_->session_id == session_id_;
    if (is_present && frame.sequence >= buffer_.first_undelivered()) return false;
    if (max_frame_bytes_ == 0 || frame.jpeg.size() <= max_frame_bytes_) break;
    if (!std::exchange(is_too_large_logged_, true)) {
      spdlog::error(
          "spool: frame {} of session {} has {} bytes, more than the server's listen.max_frame of "
          "{}: it is lost, and so are all that are larger",
          frame.sequence, next_->session_id, frame.jpeg.size(), max_frame_bytes_);
    }
    pass_over();
  }
  if (!next_) return false;
  record_ = wire::encode_late_record(next_->session_id, *next_->frame);
  sent_ = 0;
  begun_.push_back({record_.size(), true});
  begun_bytes_ += record_.size();
  next_.reset();
  return true;
}

void Backfill::pass_over() {
  next_.reset();
  begun_.push_back({});
  acknowledge(0);
}

void Backfill::wake_at(Time time) {
  timer_.expires_at(time);
  timer_.async_wait([this](const boost::system::error_code& error) {
    if (!error) wake_();
  });
}

}  // namespace orbbuf
