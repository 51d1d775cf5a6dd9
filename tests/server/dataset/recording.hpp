// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "server/session/session_store.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf::test {

inline std::unique_ptr<SessionStore> open_store(const std::filesystem::path& folder,
                                                SessionInfo info = {"r", "s", "", {}}) {
  auto store = SessionStore::open(folder, std::move(info), Durability::kSecond);
  EXPECT_TRUE(store) << store.error().text;
  return store ? std::move(store).value() : nullptr;
}

/// Behind those that the store has.
inline void write_drops(SessionStore& store, const std::vector<DropRecord>& drops) {
  const auto first = store.position()[wire::kDrops];
  ASSERT_FALSE(
      store.write_items({wire::kDrops, first, first + drops.size(), wire::encode_drops(drops)}));
}

/// A folder with one session in it, of real JPEGs: frames 0 to 9, of which 3, 4 and 7 were dropped.
class Recording : public testing::Test {
 protected:
  static constexpr int kWidth = 64;
  static constexpr int kHeight = 48;
  static constexpr int kFrames = 7;

  static const std::vector<Sequence>& delivered() {
    static const std::vector<Sequence> numbers = {0, 1, 2, 5, 6, 8, 9};
    return numbers;
  }

  static FramePtr frame(Sequence sequence, bool is_stereo = false) {
    auto left = jpeg_frame_ptr(sequence, kWidth, kHeight);
    if (!is_stereo) return left;
    return stereo_frame_ptr(left, jpeg_frame_ptr(sequence + 100, kWidth, kHeight));
  }

  std::unique_ptr<SessionStore> open(const std::string& calibration = "") const {
    return open_store(session_, {"r", "s", calibration, {}});
  }

  /// All but its end.
  std::unique_ptr<SessionStore> begin(bool is_stereo = false,
                                      const std::string& calibration = "") const {
    auto store = open(calibration);
    for (const Sequence sequence : delivered()) {
      EXPECT_FALSE(store->write(*frame(sequence, is_stereo), 0));
    }
    write_drops(*store, {{4, 4 * kFrameNs, DropReason::kPolicy},
                         {3, 3 * kFrameNs, DropReason::kBusy},
                         {7, 7 * kFrameNs, DropReason::kFailed}});
    return store;
  }

  void record(bool is_stereo = false, const std::string& calibration = "") const {
    const auto store = begin(is_stereo, calibration);
    ASSERT_FALSE(store->note({wire::Stats{10, 1, 1, 1, 7, 0, 0}, 0}));
    ASSERT_FALSE(store->finish(true));
  }

  /// What the robot still has.
  static wire::Account account(std::uint64_t held, Sequence first_held) {
    wire::Account account;
    account.session_id = "s";
    account.captured = 10;
    account.held = held;
    account.first_held = first_held;
    account.has_ended = true;
    return account;
  }

  TemporaryFolder folder_;
  std::filesystem::path session_ = folder_ / "session";
};

}  // namespace orbbuf::test
