// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

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
#include "daemon/spool/spool.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::test {

/// Any bytes for an image; others for each number and session.
inline FramePtr spool_frame(Sequence sequence, std::size_t bytes = 1000, std::uint8_t salt = 0) {
  auto frame = std::make_shared<EncodedFrame>();
  frame->sequence = sequence;
  frame->capture_time_ns =
      1'700'000'000'000'000'000 + static_cast<std::int64_t>(sequence) * 40'000'000;
  frame->exposure_ns = 8'000'000;
  frame->width_px = 640;
  frame->height_px = 480;
  frame->left_bytes = static_cast<std::uint32_t>(bytes / 2);
  frame->quality = 80;
  frame->jpeg.resize(bytes);
  std::uint64_t state = (sequence + 1) * 0x9E3779B97F4A7C15 + salt;
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

/// A spool whose thread's news the test waits for.
class WatchedSpool {
 public:
  WatchedSpool(SpoolSettings settings, const std::string& session_id,
               const std::string& robot_id = "robot")
      : spool_(std::move(settings), robot_id, session_id, [this] {
          const std::lock_guard lock(mutex_);
          ++news_;
          changed_.notify_all();
        }) {}

  Spool* operator->() { return &spool_; }

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
        throw std::runtime_error("no news from the spool for a minute");
      }
    }
  }

  /// Waits for the next frame.
  SpooledFrame next() {
    std::optional<SpooledFrame> frame;
    wait_until([&] { return (frame = spool_.next()).has_value(); });
    return std::move(*frame);
  }
  /// The numbers of the next `count` frames.
  std::vector<Sequence> take(std::size_t count) {
    std::vector<Sequence> numbers;
    while (numbers.size() < count) numbers.push_back(next().frame->sequence);
    return numbers;
  }
  void add(Sequence first, Sequence end, std::size_t bytes = 1000) {
    for (Sequence sequence = first; sequence < end; ++sequence)
      spool_.add(spool_frame(sequence, bytes));
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t news_ = 0;  // guarded by mutex_
  Spool spool_;
};

inline std::vector<Sequence> numbers(Sequence first, Sequence end) {
  std::vector<Sequence> numbers;
  for (Sequence sequence = first; sequence < end; ++sequence) numbers.push_back(sequence);
  return numbers;
}

/// With a folder that is there for one test.
class SpoolTest : public testing::Test {
 protected:
  SpoolSettings settings(std::uint64_t size_bytes = 64 << 20) const {
    return {path(), size_bytes, 0};
  }
  std::filesystem::path path() const { return folder_ / "spool"; }
  std::vector<std::filesystem::path> segments() const {
    std::vector<std::filesystem::path> found;
    for (const auto& entry : std::filesystem::directory_iterator(path())) {
      if (entry.path().extension() == ".segment") found.push_back(entry.path());
    }
    std::sort(found.begin(), found.end());
    return found;
  }

  TemporaryFolder folder_;
};

}  // namespace orbbuf::test
