// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/kept_frames.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <map>
#include <random>

namespace orbbuf {
namespace {

using State = KeptFrame::State;
constexpr Sequence kAll = std::numeric_limits<Sequence>::max();

KeptFrame written(Sequence sequence, std::uint32_t segment = 0) {
  return {sequence, segment, static_cast<std::uint32_t>(sequence * 100), 100, State::kWritten};
}

TEST(KeptFrames, NoFramesHaveNoNumbers) {
  KeptFrames frames;
  EXPECT_EQ(frames.held(), 0U);
  EXPECT_EQ(frames.first(), 0U);
  EXPECT_EQ(frames.find(0), nullptr);
  EXPECT_EQ(frames.take_next(kAll), nullptr);
  EXPECT_TRUE(frames.remove_segment(0, 1).empty());
}

TEST(KeptFrames, FramesAreTakenByNumberAndEachOnce) {
  KeptFrames frames;
  for (const Sequence sequence : {5U, 3U, 9U, 4U}) EXPECT_TRUE(frames.add(written(sequence)));
  EXPECT_FALSE(frames.add(written(9)));
  for (const Sequence sequence : {3U, 4U, 5U, 9U}) {
    EXPECT_EQ(frames.take_next(kAll)->sequence, sequence);
  }
  EXPECT_EQ(frames.take_next(kAll), nullptr);
  EXPECT_EQ(frames.held(), 4U);
}

TEST(KeptFrames, APendingOneIsNotTakenBeforeItIsWritten) {
  KeptFrames frames;
  frames.add({1});
  frames.add(written(2));
  EXPECT_EQ(frames.take_next(kAll)->sequence, 2U);
  frames.on_written(*frames.find(1), written(1));
  EXPECT_EQ(frames.take_next(kAll)->sequence, 1U);
}

TEST(KeptFrames, AnEndKeepsTheRestBack) {
  KeptFrames frames;
  for (const Sequence sequence : {1U, 2U, 3U}) frames.add(written(sequence));
  EXPECT_EQ(frames.take_next(1), nullptr);
  EXPECT_EQ(frames.take_next(2)->sequence, 1U);
  EXPECT_EQ(frames.take_next(2), nullptr);
  EXPECT_EQ(frames.take_next(kAll)->sequence, 2U);
}

TEST(KeptFrames, OneThatIsGivenBackIsNext) {
  KeptFrames frames;
  for (const Sequence sequence : {1U, 2U, 3U}) frames.add(written(sequence));
  frames.take_next(kAll);
  frames.take_next(kAll);
  frames.give_back(*frames.find(1));
  EXPECT_EQ(frames.take_next(kAll)->sequence, 1U);
  EXPECT_EQ(frames.take_next(kAll)->sequence, 3U);
}

TEST(KeptFrames, TheFirstIsTheLowestThatIsHeld) {
  KeptFrames frames;
  for (const Sequence sequence : {1U, 2U, 3U, 4U}) frames.add(written(sequence));
  frames.remove(*frames.find(2));
  EXPECT_EQ(frames.first(), 1U);
  EXPECT_EQ(frames.find(2), nullptr);
  frames.remove(*frames.find(1));
  EXPECT_EQ(frames.first(), 3U);
  frames.remove(*frames.find(4));
  EXPECT_EQ(frames.held(), 1U);
}

TEST(KeptFrames, ASegmentTakesItsFramesAlong) {
  KeptFrames frames;
  for (const Sequence sequence : {1U, 3U}) frames.add(written(sequence, 7));
  for (const Sequence sequence : {2U, 4U}) frames.add(written(sequence, 8));
  frames.add({5});
  EXPECT_EQ(frames.remove_segment(7, 2).size(), 2U);
  EXPECT_EQ(frames.first(), 2U);
  EXPECT_EQ(frames.held(), 3U);
  EXPECT_TRUE(frames.remove_segment(0, 1).empty());  // a pending one is in none
}

TEST(KeptFrames, DoesAsAMapDoes) {
  std::mt19937 random(1);  // NOLINT: repeatable
  KeptFrames frames;
  std::map<Sequence, State> expected;
  for (int step = 0; step < 20'000; ++step) {
    const Sequence sequence = static_cast<Sequence>(step / 20) + random() % 40;
    KeptFrame* const frame = frames.find(sequence);
    const auto at = expected.find(sequence);
    ASSERT_EQ(frame != nullptr, at != expected.end()) << step;
    const auto choice = random() % 4;
    if (choice == 0) {
      const auto next =
          std::ranges::find(expected, State::kWritten, &std::pair<const Sequence, State>::second);
      const KeptFrame* const taken = frames.take_next(kAll);
      ASSERT_EQ(taken != nullptr, next != expected.end()) << step;
      if (taken == nullptr) continue;
      ASSERT_EQ(taken->sequence, next->first);
      next->second = State::kTaken;
    } else if (frame == nullptr) {
      expected[sequence] = choice == 1 ? State::kPending : State::kWritten;
      ASSERT_TRUE(frames.add(choice == 1 ? KeptFrame{sequence} : written(sequence)));
    } else if (frame->state == State::kPending) {
      frames.on_written(*frame, written(sequence));
      at->second = State::kWritten;
    } else if (choice == 1) {
      frames.give_back(*frame);
      at->second = State::kWritten;
    } else {
      frames.remove(*frame);
      expected.erase(at);
    }
    ASSERT_EQ(frames.held(), expected.size());
    ASSERT_EQ(frames.first(), expected.empty() ? 0 : expected.begin()->first);
  }
}

}  // namespace
}  // namespace orbbuf
