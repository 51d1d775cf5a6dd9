// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stereo/stereo_source.hpp"

#include <utility>

#include "common/watched_thread.hpp"

namespace orbbuf {
namespace {

std::chrono::nanoseconds from_to(const RawFrame& a, const RawFrame& b) {
  return std::chrono::nanoseconds(b.monotonic_ns - a.monotonic_ns);
}

RawFrame pair_of(RawFrame left, RawFrame right) {
  left.right = std::make_shared<const RawFrame>(std::move(right));
  return left;
}

constexpr std::size_t kMostPairs = 4;  // which a reader that was held up finds waiting

double ms(std::chrono::nanoseconds time) {
  return std::chrono::duration<double, std::milli>(time).count();
}

}  // namespace

std::optional<RawFrame> StereoPairer::add(Side side, RawFrame frame) {
  Waiting& own = sides_.at(index(side));
  Waiting& other = sides_.at(1 - index(side));
  while (!other.frames.empty()) {
    const auto apart = from_to(frame, other.frames.front());
    if (apart > tolerance_) {  // and all to come are later still
      ++own.unpaired;
      return std::nullopt;
    }
    const bool has_nearer =
        other.frames.size() > 1 && std::chrono::abs(from_to(frame, other.frames[1])) < abs(apart);
    if (apart < -tolerance_ || has_nearer) {
      other.give_up_first();
      continue;
    }
    RawFrame partner = std::move(other.frames.front());
    other.frames.pop_front();
    ++pairs_;
    return side == Side::kLeft ? pair_of(std::move(frame), std::move(partner))
                               : pair_of(std::move(partner), std::move(frame));
  }
  own.frames.push_back(std::move(frame));
  if (own.frames.size() > kMostWaiting) own.give_up_first();
  return std::nullopt;
}

void StereoPairer::Waiting::give_up_first() {
  frames.pop_front();
  ++unpaired;
}

StereoSource::StereoSource(std::unique_ptr<FrameSource> left, std::unique_ptr<FrameSource> right,
                           std::chrono::nanoseconds tolerance)
    : left_(std::move(left)),
      right_(std::move(right)),
      description_(fmt::format("stereo: left {}; right {}; up to {:.4g} ms apart",
                               left_->description(), right_->description(), ms(tolerance))),
      pairer_(tolerance),
      left_thread_([this](const std::stop_token& stop) { capture(Side::kLeft, stop); }),
      right_thread_([this](const std::stop_token& stop) { capture(Side::kRight, stop); }) {}

StereoSource::~StereoSource() {
  left_thread_.request_stop();
  right_thread_.request_stop();
  left_thread_.join();
  right_thread_.join();
  log_info(
      "stereo: {} pairs, {} of them overwritten, {} left and {} right images without a partner",
      pairer_.pairs(), overtaken_, pairer_.unpaired(Side::kLeft), pairer_.unpaired(Side::kRight));
}

std::optional<RawFrame> StereoSource::next(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  wait_beating(changed_, lock, stop,
               [this] { return !pairs_.empty() || capturing_ == 0 || failure_; });
  if (stop.stop_requested()) {
    left_thread_.request_stop();
    right_thread_.request_stop();
    return std::nullopt;
  }
  if (pairs_.empty() && failure_) std::rethrow_exception(failure_);
  if (pairs_.empty()) return std::nullopt;
  std::optional<RawFrame> pair(std::move(pairs_.front()));
  pairs_.pop_front();
  return pair;
}

void StereoSource::capture(Side side, const std::stop_token& stop) {
  const bool is_left = side == Side::kLeft;
  const WatchedThread watched(is_left ? "left" : "right");
  std::exception_ptr failure;
  try {
    while (auto frame = (is_left ? left_ : right_)->next(stop)) add(side, std::move(*frame));
  } catch (const std::exception&) {
    failure = std::current_exception();
  }
  const std::lock_guard lock(mutex_);
  --capturing_;
  if (failure) failure_ = failure;
  changed_.notify_all();
}

void StereoSource::add(Side side, RawFrame frame) {
  const std::lock_guard lock(mutex_);
  if (auto pair = pairer_.add(side, std::move(frame))) {
    pairs_.push_back(std::move(*pair));
    if (pairs_.size() > kMostPairs) {
      pairs_.pop_front();
      ++overtaken_;
    }
    changed_.notify_all();
  }
  const auto unpaired = pairer_.unpaired(Side::kLeft) + pairer_.unpaired(Side::kRight);
  if (unpaired == logged_ || !unpaired_log_.lets_through()) return;
  log_warn(
      "stereo: {} images without a partner within {:.4g} ms, {} in all (not logged again "
      "for 10 s)",
      unpaired - logged_, ms(pairer_.tolerance()), unpaired);
  logged_ = unpaired;
}

}  // namespace orbbuf
