// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/backfill.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <span>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {
namespace {

using Seconds = BackfillPace::Seconds;

constexpr double kPart = 1.0 / 16;      // of a new observation in the means
constexpr double kLongestInterval = 4;  // intervals that one observation counts for
constexpr Seconds kAheadOfFree{0.002};  // how far before the link is free to write
constexpr double kShortestGuard = 0.1;  // of the interval: what is written may take longer
constexpr Seconds kUnknownInterval{1};
constexpr Seconds kLongestTurn{0.25};  // without live frames
constexpr Seconds kLongestBusy{1};     // by a rate that may be far too low, as after many losses

double or_unknown(double bytes_per_s) {
  return bytes_per_s > 0 ? bytes_per_s : BackfillPace::kUnknownRate;
}

BackfillPace::Time after(BackfillPace::Time time, Seconds later) {
  return time + std::chrono::duration_cast<BackfillPace::Clock::duration>(later);
}

}  // namespace

void BackfillPace::on_captured(Time now) {
  const Seconds since = now - std::exchange(captured_, now);
  if (!std::exchange(has_captured_, true)) return;
  if (interval_.count() <= 0) {
    interval_ = since;
    return;
  }
  const Seconds observed = std::min(since, kLongestInterval * interval_);
  deviation_ += kPart * (Seconds(std::abs((observed - interval_).count())) - deviation_);
  interval_ += kPart * (observed - interval_);
}

void BackfillPace::on_written(Time now, std::size_t bytes, double bytes_per_s) {
  const Seconds service(static_cast<double>(bytes) / or_unknown(bytes_per_s));
  const Seconds busy = std::max(now, busy_until_) - now + service;
  busy_until_ = after(now, std::min(busy, kLongestBusy));
  bytes_since_part_ += bytes;
}

BackfillPace::Turn BackfillPace::next(Time now, double bytes_per_s, Time busy_until) const {
  if (bytes_since_part_ >= kMostBetween) return {kLeastBytes, {}};
  busy_until = std::max(busy_until, busy_until_);
  if (busy_until > after(now, kAheadOfFree)) return {0, busy_until};
  const Time free = std::max(now, busy_until);
  Seconds window = kLongestTurn;
  const Time late = after(captured_, 2 * interval_);  // none is expected any more
  const Time second = after(captured_, kUnknownInterval);
  if (has_captured_ && interval_.count() <= 0 && now < second) return {0, second};
  if (has_captured_ && now < late) {
    const Seconds guard = std::clamp(2 * deviation_, kShortestGuard * interval_, interval_ / 4);
    window = after(captured_, interval_ - guard) - free;
  }
  const double fits = window.count() * or_unknown(bytes_per_s);
  if (fits >= kLeastBytes)
    return {static_cast<std::size_t>(std::min<double>(fits, kMostBytes)), {}};
  return has_captured_ && now < late ? Turn{0, late} : Turn{kLeastBytes, {}};
}

Backfill::Backfill(boost::asio::io_context& io, Record& record, std::function<void()> wake)
    : record_(record), wake_(std::move(wake)), timer_(io) {}

void Backfill::on_connected(bool takes_late, bool takes_accounts, std::uint32_t max_frame_bytes) {
  on_disconnected();
  takes_late_ = takes_late;
  takes_accounts_ = takes_accounts;
  max_frame_bytes_ = max_frame_bytes;
  if (takes_late || !record_.keeps_frames()) return;
  log_warn(
      "link: the server takes no late frames, since its files.enabled is false; the robot keeps "
      "them");
}

void Backfill::on_disconnected() {
  takes_late_ = takes_accounts_ = false;
  late_record_.clear();
  sent_ = 0;
  next_late_ = next_account_ = told_ = 0;
  begun_.clear();
  begun_bytes_ = 0;
  timer_.cancel();
  accounts_.clear();
  account_time_ = {};
  last_words_.clear();
  record_.rewind();
}

void Backfill::on_ack(const wire::Position& position) {
  const auto late = std::min(position[wire::kLate], next_late_);  // no more than was sent
  for (; !begun_.empty() && begun_.front().number < late; begun_.pop_front()) {
    record_.remove(begun_.front().id);
    begun_bytes_ -= begun_.front().bytes;
  }
  told_ = std::max(told_, std::min(position[wire::kAccounts], next_account_));
  for (; !last_words_.empty() && last_words_.front().number < told_; last_words_.pop_front()) {
    record_.settle(last_words_.front().session_id);
  }
}

std::optional<wire::Items> Backfill::take_account(Time now, bool final) {
  if (!takes_accounts_) return std::nullopt;
  if (accounts_.empty() && (final || now >= account_time_)) {
    auto accounts = record_.take_accounts();
    accounts_.assign(std::move_iterator(accounts.begin()), std::move_iterator(accounts.end()));
    account_time_ = now + kAccountInterval;
  }
  if (accounts_.empty() || (!final && next_account_ - told_ >= kMostAccounts)) return std::nullopt;
  const wire::Account account = std::move(accounts_.front());
  accounts_.pop_front();
  if (account.is_final && !account.is_held()) {
    last_words_.push_back({next_account_, account.session_id});
  }
  return wire::Items{wire::kAccounts, next_account_++, wire::encode_account(account)};
}

std::optional<wire::Items> Backfill::take_part(Time now, double bytes_per_s, Time busy_until) {
  if (!takes_late_ || !accounts_.empty()) return std::nullopt;
  if (late_record_.empty() && !begin_frame()) return std::nullopt;
  const auto turn = pace_.next(now, bytes_per_s, busy_until);
  if (turn.bytes == 0) {
    wake_at(turn.again);
    return std::nullopt;
  }
  const auto rest = std::span(late_record_).subspan(sent_);
  const auto bytes = rest.first(std::min(turn.bytes, rest.size()));
  const wire::LatePart part{static_cast<std::uint32_t>(sent_),
                            static_cast<std::uint32_t>(late_record_.size()), bytes};
  wire::Items items{wire::kLate, next_late_, wire::encode_late_part(part)};
  sent_ += bytes.size();
  if (sent_ == late_record_.size()) {
    late_record_.clear();
    ++next_late_;
  }
  return items;
}

/// False if there is none to be sent now.
bool Backfill::begin_frame() {
  constexpr std::size_t kLeast = 2;
  if (begun_.size() >= kLeast && begun_bytes_ >= kMostUnacknowledged) return false;
  while (const auto next = record_.next()) {
    record_.take_next();
    const FramePtr& frame = next->frame;
    if (!frame || max_frame_bytes_ == 0 || frame->jpeg.size() <= max_frame_bytes_) {
      late_record_ = frame ? wire::encode_late_record(next->session_id, *frame)
                           : wire::encode_late_record(next->session_id, next->items);
      sent_ = 0;
      begun_.push_back({next_late_, next->id, late_record_.size()});
      begun_bytes_ += late_record_.size();
      return true;
    }
    record_.remove(next->id);
    if (std::exchange(is_too_large_logged_, true)) continue;
    log_error(
        "record: frame {} of session {} has {} bytes, more than the server's listen.max_frame of "
        "{}: it is lost, and so are all that are larger",
        frame->sequence, next->session_id, frame->jpeg.size(), max_frame_bytes_);
  }
  return false;
}

void Backfill::wake_at(Time time) {
  timer_.expires_at(time);
  timer_.async_wait([this](const boost::system::error_code& error) {
    if (!error) wake_();
  });
}

}  // namespace orbbuf
