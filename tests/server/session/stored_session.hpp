// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/journal/journal.hpp"
#include "server/session/session_reader.hpp"
#include "server/session/session_store.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf::test {

inline constexpr std::int64_t kArrivedNs = 1'763'779'406'123'456'789;

/// A reduced frame, and the whole one that it was made from.
struct ReducedPair {
  EncodedFrame reduced;
  EncodedFrame whole;
};
inline ReducedPair reduced_pair(EncodedFrame reduced, EncodedFrame whole,
                                std::uint8_t quality = 30) {
  whole.quality = 80;
  reduced.quality = quality;
  reduced.whole_bytes = static_cast<std::uint32_t>(whole.jpeg.size());
  reduced.whole_crc = whole.jpeg_crc;
  return {std::move(reduced), std::move(whole)};
}
inline ReducedPair reduced_pair(Sequence sequence, std::uint8_t quality = 30) {
  return reduced_pair(plain_frame(sequence, 60), plain_frame(sequence, 200), quality);
}
inline ReducedPair reduced_stereo_pair(Sequence sequence) {
  return reduced_pair(plain_pair(sequence, 30, 40), plain_pair(sequence, 90, 110));
}

inline RecordedItems dropped(std::uint64_t first, const std::vector<DropRecord>& records) {
  return {wire::kDrops, first, first + records.size(), wire::encode_drops(records)};
}

inline wire::Account account(Sequence captured, std::uint64_t held = 0, Sequence first_held = 0,
                             bool is_final = true) {
  wire::Account account;
  account.session_id = "session";
  account.is_final = is_final;
  account.captured = captured;
  account.held = held;
  account.first_held = first_held;
  return account;
}

/// A session's folder, and what is done with it.
class StoredSession : public testing::Test {
 protected:
  using StorePtr = std::unique_ptr<SessionStore>;

  StorePtr open(Durability durability = Durability::kAck, const std::string& calibration = "") {
    auto store = SessionStore::open(folder_, {"robot", "session", calibration}, durability);
    EXPECT_TRUE(store) << (store ? "" : store.error().text);
    return store ? std::move(store).value() : nullptr;
  }
  static void write(SessionStore& store, const EncodedFrame& frame) {
    const auto error = store.write(frame, kArrivedNs);
    EXPECT_FALSE(error) << error->text;
  }
  static void deliver(SessionStore& store, const std::vector<Sequence>& numbers) {
    for (const Sequence number : numbers) write(store, plain_frame(number));
  }
  static SessionStore::Late late(SessionStore& store, const EncodedFrame& frame) {
    const auto outcome = store.write_late(frame, kArrivedNs);
    EXPECT_TRUE(outcome) << (outcome ? "" : outcome.error().text);
    return outcome ? outcome.value() : SessionStore::Late::kConflict;
  }
  /// As a server that is killed leaves it.
  void record(const std::vector<Sequence>& numbers) { deliver(*open(), numbers); }

  Sequence next() { return open()->position()[wire::kFrames]; }
  RecordedSession read() const {
    auto session = read_session(folder_);
    EXPECT_TRUE(session) << (session ? "" : session.error().text);
    return session ? std::move(session).value() : RecordedSession{};
  }
  std::vector<Sequence> numbers() const {
    std::vector<Sequence> numbers;
    for (const RecordedFrame& frame : read().frames) numbers.push_back(frame.sequence);
    return numbers;
  }
  /// Of times.txt.
  std::vector<Sequence> listed() const {
    std::vector<Sequence> numbers;
    for (const std::string& line : read_lines(folder_ / "times.txt")) {
      numbers.push_back(std::stoull(line));
    }
    return numbers;
  }
  /// All that is recorded is there as it was received.
  void expect_whole() const {
    for (const RecordedFrame& frame : read().frames) {
      const auto images = read_images(folder_, frame);
      EXPECT_TRUE(images && is_whole(frame, images.value())) << frame.sequence;
    }
  }
  std::vector<std::string> names(const std::string& folder = "") const {
    std::vector<std::string> found;
    std::error_code none;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / folder, none)) {
      found.push_back(entry.path().filename());
    }
    std::ranges::sort(found);
    return found;
  }
  std::string image(Sequence number) const { return read_file(folder_ / session_image(number)); }
  static std::string session_image(Sequence number) {
    return fmt::format("images/{:06}.jpg", number);
  }
  std::filesystem::path journal(std::uint32_t segment = 0) const {
    return journal::segment_path(folder_, segment);
  }

  TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_ / "robot" / "session";
};

}  // namespace orbbuf::test
