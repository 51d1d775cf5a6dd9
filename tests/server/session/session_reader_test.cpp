// SPDX-License-Identifier: Apache-2.0
#include "server/session/session_reader.hpp"

#include <gmock/gmock.h>

#include "tests/server/session/stored_session.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::account;
using test::dropped;
using test::plain_frame;
using test::plain_pair;
using test::reduced_pair;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

class SessionReaderTest : public test::StoredSession {
 protected:
  /// `first-last reason`, each.
  std::vector<std::string> drops() const {
    std::vector<std::string> texts;
    for (const DropRecord& drop : read().drops) {
      texts.push_back(
          fmt::format("{}-{} {}", drop.sequence, drop.end() - 1, to_string(drop.reason)));
    }
    return texts;
  }
};

TEST_F(SessionReaderTest, WhereThereIsNoJournalThereIsNoSession) {
  const auto session = read_session(folder_);
  ASSERT_FALSE(session);
  EXPECT_EQ(session.error().text, folder_.string() + ": not a session: No such file or directory");
  EXPECT_FALSE(read_summary(folder_));
}

TEST_F(SessionReaderTest, ARobotsFolderNamesOneOfItsSessions) {
  for (const char* session : {"s1", "s2", "none"}) fs::create_directories(folder_ / "r" / session);
  for (const char* session : {"s1", "s2"}) {
    test::write_file(folder_ / "r" / session / "journal.000000", "");
  }
  EXPECT_EQ(read_session(folder_ / "r").error().text,
            (folder_ / "r").string() +
                ": not a session, but the folder of a robot: name one of its sessions, such as " +
                (folder_ / "r/s2").string());
  EXPECT_EQ(read_session(folder_ / "nowhere").error().text,
            (folder_ / "nowhere").string() + ": not a session: No such file or directory");
}

TEST_F(SessionReaderTest, TheRecordOfARobotIsNoSession) {
  fs::create_directories(folder_ / "spool");
  test::write_file(folder_ / "spool/lock", "");
  test::write_file(folder_ / "spool/journal.000000", std::string(100, 'x'));
  EXPECT_EQ(read_session(folder_ / "spool").error().text,
            (folder_ / "spool").string() +
                ": not a session, but the record of an orbbufd (spool.path or buffer.drop_log); "
                "sessions are in the server's files.path");
}

TEST_F(SessionReaderTest, HasTheFramesByNumberAndEachOnce) {
  const auto [reduced, whole] = reduced_pair(4);
  const auto store = open();
  deliver(*store, {1, 3});
  write(*store, reduced);
  late(*store, plain_frame(2));
  late(*store, whole);
  deliver(*store, {6});
  late(*store, plain_frame(0));
  late(*store, plain_frame(9));
  EXPECT_THAT(numbers(), ElementsAre(0, 1, 2, 3, 4, 6, 9));
  const auto session = read();
  EXPECT_EQ(session.frames[4].bytes, whole.jpeg.size());
  EXPECT_EQ(session.summary, store->summary());
  EXPECT_EQ(read_summary(folder_), store->summary());
  EXPECT_THAT(session.problems, IsEmpty());
}

TEST_F(SessionReaderTest, WhatComesBehindTheOutlineIsNotInIt) {
  const auto store = open();
  deliver(*store, {0, 2});
  const auto outline = read_outline(folder_).value();
  deliver(*store, {3});
  late(*store, plain_frame(1));
  std::vector<Sequence> frames;
  EXPECT_TRUE(for_each_frame(
      folder_, outline, [&](const RecordedFrame& frame) { frames.push_back(frame.sequence); }));
  EXPECT_THAT(frames, ElementsAre(0, 2));
}

TEST_F(SessionReaderTest, WhatIsNamedAndCameLateIsNoDrop) {
  const auto store = open();
  deliver(*store, {0});
  EXPECT_FALSE(store->write_items(dropped(
      0, {{5, 50, DropReason::kBusy}, {1, 10, DropReason::kPolicy, kUnknownSimilarity, 4, 40}})));
  EXPECT_THAT(drops(), ElementsAre("1-4 policy", "5-5 busy"));
  late(*store, plain_frame(3));
  EXPECT_THAT(drops(), ElementsAre("1-2 policy", "4-4 policy", "5-5 busy"));
  const auto parts = read().drops;
  EXPECT_EQ(parts[0].last_capture_time_ns, 20);
  EXPECT_EQ(parts[1].capture_time_ns, 40);
  for (const Sequence i : {1U, 2U, 4U, 5U}) late(*store, plain_frame(i));
  EXPECT_THAT(drops(), IsEmpty());
}

TEST_F(SessionReaderTest, WhatIsNamedTwiceIsOneDrop) {
  const auto store = open();
  deliver(*store, {0, 9});
  EXPECT_FALSE(store->write_items(dropped(0, {{1, 10, DropReason::kPolicy, 0, 4, 40}})));
  wire::Account named = account(10, 0, 0, false);
  named.given_up = {{3, 30, DropReason::kShutdown, 0, 4, 60}, {2, 20, DropReason::kBusy}};
  EXPECT_FALSE(store->take_account(named));
  EXPECT_THAT(drops(), ElementsAre("1-4 policy", "5-6 shutdown"));
}

TEST_F(SessionReaderTest, WhatTheRobotDoesNotKnowAndIsThereIsNoDrop) {
  const auto store = open();
  deliver(*store, {0, 1, 3});
  wire::Account named = account(4);
  named.given_up = {{1, 10, DropReason::kUnknown, kUnknownSimilarity, 3, 30}};
  EXPECT_FALSE(store->take_account(named));
  EXPECT_THAT(drops(), ElementsAre("2-2 unknown"));
}

TEST_F(SessionReaderTest, AFinalAccountNamesWhatNothingElseNames) {
  const auto store = open();
  deliver(*store, {0, 1, 4, 9});
  EXPECT_FALSE(store->write_items(dropped(0, {{5, 1, DropReason::kPolicy}})));
  wire::Account said = account(15, 0, 0, false);
  said.confirmed = 8;
  EXPECT_FALSE(store->take_account(said));
  EXPECT_THAT(drops(), ElementsAre("5-5 policy"));
  said.is_final = true;
  said.last_capture_time_ns = 15 * test::kFrameNs;
  EXPECT_FALSE(store->take_account(said));
  EXPECT_THAT(drops(),
              ElementsAre("2-3 lost", "5-5 policy", "6-7 lost", "8-8 unknown", "10-14 unknown"));
  for (const DropRecord& drop : read().drops) {
    if (drop.reason == DropReason::kPolicy) continue;
    EXPECT_EQ(drop.capture_time_ns, static_cast<std::int64_t>(drop.sequence) * test::kFrameNs);
    EXPECT_EQ(drop.capture_time_of(drop.end() - 1),
              static_cast<std::int64_t>(drop.end() - 1) * test::kFrameNs);
  }
}

TEST_F(SessionReaderTest, WhatTheRobotHoldsMayStillCome) {
  const auto store = open();
  deliver(*store, {0, 1, 4});
  EXPECT_FALSE(store->take_account(account(10, 3, 5)));
  EXPECT_THAT(drops(), ElementsAre("2-3 unknown"));
  EXPECT_FALSE(store->take_account(account(10)));
  EXPECT_THAT(drops(), ElementsAre("2-3 unknown", "5-9 unknown"));
}

TEST_F(SessionReaderTest, AHugeRangeIsOneDrop) {
  const auto store = open();
  deliver(*store, {0});
  EXPECT_FALSE(store->take_account(account(Sequence{1} << 62)));
  EXPECT_THAT(read().drops, SizeIs(1));
}

TEST_F(SessionReaderTest, AJournalWithoutACheckpointIsReadAsFarAsItGoes) {
  record({0, 1});
  std::string bytes = test::read_file(journal());
  bytes[20] ^= 1;
  test::write_file(journal(), bytes);
  const auto session = read();
  EXPECT_THAT(session.frames, SizeIs(2));
  EXPECT_EQ(session.summary.info.robot_id, "robot");
  EXPECT_EQ(session.summary.info.session_id, "session");
  EXPECT_THAT(session.problems, SizeIs(1));
}

TEST_F(SessionReaderTest, ItemsComeInTheirOrder) {
  const auto store = open();
  const std::vector<RecordedItems> samples = {
      {5, 0, 2, {1, 2}}, {6, 0, 2, {9}}, {5, 2, 3, {3}}, {6, 2, 3, {9}}};
  for (const RecordedItems& items : samples) EXPECT_FALSE(store->write_items(items));
  std::vector<RecordedItems> found;
  EXPECT_FALSE(read_items(folder_, [&](const RecordedItems& items) { found.push_back(items); }));
  EXPECT_EQ(found, samples);
}

TEST_F(SessionReaderTest, LateSamplesAreMergedRecordByRecord) {
  wire::Account said = account(0);
  said.streams = {{{4, "imu0", "imu"}, 40, 10}};
  const auto store = open();
  EXPECT_FALSE(store->take_account(said));
  const auto samples = [](std::uint64_t first, std::uint64_t end) {
    std::vector<Sample> all;
    for (; first < end; ++first) all.push_back({static_cast<std::int64_t>(first), {}, {}});
    return wire::encode_samples(all);
  };
  EXPECT_FALSE(store->write_items({4, 0, 2, samples(0, 2)}));
  // They come in any order, lie over each other and over what came live.
  constexpr std::pair<std::uint64_t, std::uint64_t> kLate[] = {{20, 25}, {1, 9},   {11, 14},
                                                               {3, 6},   {24, 30}, {8, 12}};
  for (const auto& [first, end] : kLate) {
    EXPECT_FALSE(store->write_late(wire::Items{4, first, samples(first, end)}));
  }
  EXPECT_FALSE(store->write_items({4, 10, 11, samples(10, 11)}));
  EXPECT_FALSE(store->write_items({4, 15, 16, samples(15, 16)}));
  std::vector<std::int64_t> times;
  const auto totals = for_each_sample(
      folder_, {4, "imu0", "imu"}, [&](const Sample& sample) { times.push_back(sample.time_ns); });
  ASSERT_TRUE(totals);
  EXPECT_THAT(times, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 15, 20, 21, 22, 23,
                                 24, 25, 26, 27, 28, 29));
  EXPECT_EQ(totals.value().next, 40U);
  EXPECT_EQ(totals.value().on_robot, 10U);
  EXPECT_EQ(totals.value().lost(), 5U);
  EXPECT_EQ(totals.value().backward, 0U);
}

class FrameFollowerTest : public test::StoredSession {
 protected:
  static constexpr Sequence kNone = ~Sequence{0};

  FramePtr next_frame(Sequence first) {
    auto frame = follower_.next(first);
    EXPECT_TRUE(frame);
    return frame ? frame.value() : nullptr;
  }
  Sequence next_sequence(Sequence first) {
    const auto frame = next_frame(first);
    return frame ? frame->sequence : kNone;
  }

  FrameFollower follower_{folder_};
};

TEST_F(FrameFollowerTest, GivesFramesBackAsTheyWereKept) {
  const auto store = open();
  EncodedFrame frame = plain_pair(7, 300, 200);
  frame.capture_time_ns = -1'500'000'001;
  frame.width_px = 640;
  frame.height_px = 480;
  frame.quality = 30;
  frame.whole_bytes = 40'123;
  frame.whole_crc = 5;
  write(*store, frame);
  const auto got = next_frame(0);
  ASSERT_TRUE(got && got->is_stereo());
  EXPECT_EQ(got->sequence, 7U);
  EXPECT_EQ(got->capture_time_ns, frame.capture_time_ns);
  EXPECT_EQ(got->exposure_ns, frame.exposure_ns);
  EXPECT_EQ(got->width_px, 640);
  EXPECT_EQ(got->jpeg, frame.jpeg);
  EXPECT_EQ(got->jpeg_crc, frame.jpeg_crc);
  EXPECT_EQ(got->left_bytes, 300U);
  EXPECT_EQ(got->quality, 30);
  EXPECT_EQ(got->whole_bytes, 40'123U);
}

TEST_F(FrameFollowerTest, GoesOnWithWhatCameMeanwhile) {
  EXPECT_EQ(next_sequence(0), kNone);  // not even a folder
  const auto store = open();
  deliver(*store, {0, 2});
  EXPECT_EQ(next_sequence(0), 0U);
  EXPECT_EQ(next_sequence(1), 2U);
  EXPECT_EQ(next_sequence(3), kNone);
  late(*store, plain_frame(1));
  EXPECT_EQ(next_sequence(3), kNone);
  deliver(*store, {3});
  EXPECT_EQ(next_sequence(3), 3U);
  EXPECT_EQ(next_sequence(1), 2U);  // and begins again
}

TEST_F(FrameFollowerTest, AFrameThatWasReplacedIsTheWholeOne) {
  const auto [reduced, whole] = reduced_pair(0);
  const auto store = open();
  write(*store, reduced);
  late(*store, whole);
  EXPECT_EQ(next_frame(0)->jpeg, whole.jpeg);
  EXPECT_FALSE(next_frame(0)->is_reduced());
}

TEST_F(FrameFollowerTest, BeginsAnywhereInALongSession) {
  const auto store = open();
  for (Sequence i = 0; i < 300; ++i) {
    write(*store, plain_frame(i, 10));
    EXPECT_FALSE(store->write_items({5, i, i + 1, std::vector<std::uint8_t>(20'000)}));
  }
  ASSERT_GT(journal::segments_in(folder_).value().size(), 3U);
  for (Sequence i = 200; i < 300; ++i) ASSERT_EQ(next_sequence(i), i);
  EXPECT_EQ(next_sequence(300), kNone);
  for (const Sequence i : {10U, 250U, 0U}) EXPECT_EQ(next_sequence(i), i);
}

TEST_F(FrameFollowerTest, AFrameThatWasRemovedIsPassedOver) {
  const test::CapturedLog log;
  record({0, 1});
  std::filesystem::remove(folder_ / "images/000000.jpg");
  EXPECT_EQ(next_sequence(0), 1U);
  EXPECT_THAT(log.lines("passed over frame 0: read " + (folder_ / "images/000000.jpg").string()),
              SizeIs(1));
}

}  // namespace
}  // namespace orbbuf
