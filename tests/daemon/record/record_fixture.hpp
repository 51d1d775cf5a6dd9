// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/frame.hpp"
#include "common/wire.hpp"
#include "daemon/record/record.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::test {

constexpr std::int64_t kFirstCapture = 1'700'000'000'000'000'000;
constexpr std::int64_t kFrameTime = 40'000'000;

inline std::int64_t capture_time(Sequence sequence) {
  return kFirstCapture + static_cast<std::int64_t>(sequence) * kFrameTime;
}

/// Any bytes for an image; others for each number.
inline FramePtr kept_frame(Sequence sequence, std::size_t bytes = 1000) {
  auto frame = std::make_shared<EncodedFrame>();
  frame->sequence = sequence;
  frame->capture_time_ns = capture_time(sequence);
  frame->exposure_ns = 8'000'000;
  frame->width_px = 640;
  frame->height_px = 480;
  frame->left_bytes = static_cast<std::uint32_t>(bytes / 2);
  frame->quality = 80;
  frame->jpeg.resize(bytes);
  std::uint64_t state = (sequence + 1) * 0x9E3779B97F4A7C15;
  for (auto& byte : frame->jpeg) {
    state = state * 6364136223846793005 + 1442695040888963407;
    byte = static_cast<std::uint8_t>(state >> 56);
  }
  frame->jpeg_crc = wire::crc32(frame->jpeg);
  return frame;
}

inline bool is_same(const EncodedFrame& one, const EncodedFrame& other) {
  return one.sequence == other.sequence && one.capture_time_ns == other.capture_time_ns &&
         one.exposure_ns == other.exposure_ns && one.width_px == other.width_px &&
         one.height_px == other.height_px && one.left_bytes == other.left_bytes &&
         one.jpeg_crc == other.jpeg_crc && one.quality == other.quality && one.jpeg == other.jpeg;
}

inline DropRecord drop(Sequence sequence, DropReason reason = DropReason::kPolicy) {
  return {sequence, capture_time(sequence), reason};
}

/// So many frames were captured, of which the server has confirmed the first.
inline SessionProgress progress(Sequence captured, Sequence confirmed = 0) {
  return {captured, capture_time(captured) - kFrameTime, confirmed, confirmed};
}

inline std::vector<Sequence> numbers(Sequence first, Sequence end) {
  std::vector<Sequence> numbers;
  for (Sequence sequence = first; sequence < end; ++sequence) numbers.push_back(sequence);
  return numbers;
}

/// A record whose thread's news the test waits for.
class WatchedRecord {
 public:
  WatchedRecord(RecordSettings settings, const std::string& session_id,
                const std::string& robot_id = "robot")
      : record_(std::move(settings), robot_id, session_id, [this] {
          const std::lock_guard lock(mutex_);
          ++news_;
          changed_.notify_all();
        }) {}

  Record* operator->() { return &record_; }

  /// Until `is_so`, which the test's thread asks after each piece of news.
  template <class Fact>
  void wait_until(Fact is_so) {
    for (;;) {
      std::unique_lock lock(mutex_);
      const auto seen = news_;
      lock.unlock();
      if (is_so()) return;
      lock.lock();
      if (!changed_.wait_for(lock, std::chrono::minutes(1), [&] { return news_ != seen; })) {
        throw std::runtime_error("no news from the record for a minute");
      }
    }
  }

  /// Waits for the next frame, and takes it.
  Record::LateFrame next() {
    std::optional<Record::LateFrame> frame;
    wait_until([&] { return (frame = record_.next()).has_value(); });
    record_.take_next();
    return std::move(*frame);
  }
  /// The next `count` frames.
  std::vector<Record::LateFrame> take_frames(std::size_t count) {
    std::vector<Record::LateFrame> frames;
    while (frames.size() < count) frames.push_back(next());
    return frames;
  }
  /// Their numbers.
  std::vector<Sequence> take(std::size_t count) {
    std::vector<Sequence> numbers;
    for (const auto& frame : take_frames(count)) numbers.push_back(frame.frame->sequence);
    return numbers;
  }
  /// The server gets them.
  void deliver(std::size_t count) {
    for (const auto& frame : take_frames(count)) record_.remove(frame.id);
  }
  void keep(Sequence first, Sequence end, std::size_t bytes = 1000) {
    for (Sequence sequence = first; sequence < end; ++sequence) {
      record_.keep(kept_frame(sequence, bytes));
    }
  }
  /// Of the session, the several parts of one put together.
  std::optional<wire::Account> account_of(const std::string& session_id) {
    std::optional<wire::Account> found;
    for (wire::Account& account : record_.take_accounts()) {
      if (account.session_id != session_id) continue;
      if (found) {
        account.given_up.insert(account.given_up.begin(), found->given_up.begin(),
                                found->given_up.end());
      }
      found = std::move(account);
    }
    return found;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t news_ = 0;  // guarded by mutex_
  Record record_;
};

/// With a folder that is there for one test.
class RecordTest : public testing::Test {
 protected:
  RecordSettings settings(std::uint64_t size_bytes = 64 << 20) const {
    return {path(), true, size_bytes, 0};
  }
  RecordSettings without_frames() const { return {path()}; }
  std::filesystem::path path() const { return folder_ / "record"; }
  std::vector<std::uint32_t> segments() const { return journal::segments_in(path()).value(); }
  std::filesystem::path segment(std::uint32_t number) const {
    return journal::segment_path(path(), number);
  }

  TemporaryFolder folder_;
};

}  // namespace orbbuf::test
