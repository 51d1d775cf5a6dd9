// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/kept_frames.hpp"

#include <algorithm>

namespace orbbuf {

using State = KeptFrame::State;

KeptFrames::Frames::iterator KeptFrames::from(Sequence sequence) {
  return std::ranges::lower_bound(frames_, sequence, {}, &KeptFrame::sequence);
}

bool KeptFrames::add(const KeptFrame& frame) {
  auto at = frames_.end();  // nearly always
  if (!frames_.empty() && frames_.back().sequence >= frame.sequence) at = from(frame.sequence);
  if (at == frames_.end() || at->sequence != frame.sequence) {
    frames_.insert(at, frame);
  } else if (at->state == State::kGone) {
    *at = frame;
  } else {
    return false;
  }
  held_ += frame.count;
  if (frame.state == State::kWritten) next_ = std::min(next_, frame.sequence);
  return true;
}

KeptFrame* KeptFrames::find(Sequence sequence) {
  const auto at = from(sequence);
  const bool is_here = at != frames_.end() && at->sequence == sequence && at->state != State::kGone;
  return is_here ? &*at : nullptr;
}

void KeptFrames::on_written(KeptFrame& frame, const KeptFrame& place) {
  const bool is_late = frame.is_late;
  frame = place;
  frame.is_late = is_late;
  next_ = std::min(next_, frame.sequence);
}

const KeptFrame* KeptFrames::take_next(Sequence end) {
  for (auto at = from(next_); at != frames_.end() && at->sequence < end; ++at) {
    next_ = at->sequence + 1;
    if (at->state != State::kWritten || !at->is_late) continue;
    at->state = State::kTaken;
    return &*at;
  }
  return nullptr;
}

void KeptFrames::give_back(KeptFrame& frame) {
  if (frame.state != State::kTaken) return;
  frame.state = State::kWritten;
  next_ = std::min(next_, frame.sequence);
}

void KeptFrames::remove(KeptFrame& frame) {
  frame.state = State::kGone;
  held_ -= frame.count;
  trim();
}

KeptFrame* KeptFrames::find_done(Sequence end) {
  for (KeptFrame& frame : frames_) {
    if (frame.end() > end) return nullptr;
    if (frame.state != State::kGone && !frame.is_late) return &frame;
  }
  return nullptr;
}

void KeptFrames::set_late(Sequence begin, Sequence end) {
  for (KeptFrame& frame : frames_) {
    if (frame.end() <= begin || frame.is_late) continue;
    if (frame.sequence >= end) return;
    frame.is_late = true;
    next_ = std::min(next_, frame.sequence);
  }
}

std::vector<KeptFrame> KeptFrames::remove_segment(std::uint32_t segment, std::uint64_t most) {
  std::vector<KeptFrame> removed;
  for (auto at = frames_.begin(); at != frames_.end() && removed.size() < most; ++at) {
    const bool is_in = at->state == State::kWritten || at->state == State::kTaken;
    if (!is_in || at->segment != segment) continue;
    removed.push_back(*at);
    at->state = State::kGone;
    held_ -= at->count;
  }
  trim();
  return removed;
}

void KeptFrames::trim() {
  while (!frames_.empty() && frames_.front().state == State::kGone) frames_.pop_front();
  while (!frames_.empty() && frames_.back().state == State::kGone) frames_.pop_back();
}

}  // namespace orbbuf
