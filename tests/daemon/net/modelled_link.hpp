// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

namespace orbbuf {

/// One TCP connection over a link with a rate, a queue, a bucket of tokens that passes a burst at
/// once, and a round trip, in steps of 0.1 ms: slow start, losses at the end of the queue, and
/// repetitions behind which the receiver's frames wait. Bytes are whole segments.
class ModelledLink {
 public:
  struct Path {
    double bytes_per_s = 0;
    double queue_s = 0;
    double burst_bytes = 0;
    double round_trip_s = 0;
  };
  static constexpr double kStepS = 1e-4;
  static constexpr double kSegment = 1448;

  explicit ModelledLink(const Path& path) : path_(path), tokens_(path.burst_bytes) {}

  void write(std::size_t bytes) {
    segments_.resize(segments_.size() + (bytes + static_cast<std::size_t>(kSegment) - 1) /
                                            static_cast<std::size_t>(kSegment));
  }
  std::size_t written() const { return segments_.size(); }
  std::size_t unsent() const { return segments_.size() - next_; }
  /// Segments that the receiver has without a hole.
  std::size_t received() const { return received_; }

  void step() {
    now_s_ += kStepS;
    pass();
    deliver();
    hear();
    send();
  }

 private:
  struct Segment {
    double sent_s = 0;
    bool has_arrived = false;
    bool is_acked = false;
    bool is_lost = false;
  };
  struct Packet {
    std::size_t segment = 0;
    double sent_s = 0;
    double due_s = 0;
  };

  void pass() {
    tokens_ = std::min(path_.burst_bytes, tokens_ + path_.bytes_per_s * kStepS);
    for (; !queue_.empty() && tokens_ >= kSegment; queue_.pop_front()) {
      tokens_ -= kSegment;
      queue_.front().due_s = now_s_ + path_.round_trip_s / 2;
      there_.push_back(queue_.front());
    }
  }
  void deliver() {
    for (; !there_.empty() && there_.front().due_s <= now_s_; there_.pop_front()) {
      segments_[there_.front().segment].has_arrived = true;
      there_.front().due_s = now_s_ + path_.round_trip_s / 2;
      back_.push_back(there_.front());
    }
    while (received_ < next_ && segments_[received_].has_arrived) ++received_;
  }
  /// What was sent before a segment that has arrived, and has not, is lost.
  void hear() {
    for (; !back_.empty() && back_.front().due_s <= now_s_; back_.pop_front()) {
      Segment& acked = segments_[back_.front().segment];
      if (!acked.is_acked && !acked.is_lost) --under_way_;
      acked.is_acked = true;
      window_ += window_ < threshold_ ? 1 : 1 / window_;
      heard_s_ = now_s_;
      while (first_ < next_ && segments_[first_].is_acked) ++first_;
      for (std::size_t i = first_; i < next_; ++i) {
        if (segments_[i].sent_s < back_.front().sent_s) lose(i);
      }
    }
    if (under_way_ == 0 || now_s_ - heard_s_ < kTimeoutS + path_.round_trip_s) return;
    for (std::size_t i = first_; i < next_; ++i) lose(i);
    heard_s_ = now_s_;
    window_ = 2;
  }
  void lose(std::size_t i) {
    Segment& segment = segments_[i];
    if (segment.is_acked || segment.is_lost) return;
    segment.is_lost = true;
    again_.push_back(i);
    --under_way_;
    if (segment.sent_s <= reduced_s_) return;
    reduced_s_ = now_s_;
    threshold_ = window_ = std::max(2.0, 0.7 * window_);
  }
  void send() {
    for (; !again_.empty() && static_cast<double>(under_way_) < window_; again_.pop_front()) {
      if (!segments_[again_.front()].is_acked) send(again_.front());
    }
    while (again_.empty() && next_ < segments_.size() &&
           static_cast<double>(under_way_) < window_) {
      send(next_++);
    }
  }
  void send(std::size_t i) {
    if (under_way_++ == 0) heard_s_ = now_s_;
    segments_[i].is_lost = false;
    segments_[i].sent_s = now_s_;
    const double room = path_.bytes_per_s * path_.queue_s + path_.burst_bytes;
    if (static_cast<double>(queue_.size() + 1) * kSegment <= room) queue_.push_back({i, now_s_, 0});
  }

  static constexpr double kTimeoutS = 0.2;

  const Path path_;
  double now_s_ = 0;
  double tokens_;
  std::deque<Packet> queue_;  // of the link
  std::deque<Packet> there_;
  std::deque<Packet> back_;
  std::vector<Segment> segments_;
  std::size_t first_ = 0;  // that is not acknowledged
  std::size_t next_ = 0;   // that was never sent
  std::size_t received_ = 0;
  std::deque<std::size_t> again_;
  std::size_t under_way_ = 0;
  double window_ = 10;  // segments
  double threshold_ = 1e9;
  double reduced_s_ = -1;
  double heard_s_ = 0;
};

}  // namespace orbbuf
