// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/join_session.hpp"

#include <gmock/gmock.h>

#include "server/dataset/check_session.hpp"
#include "server/session/session_reader.hpp"
#include "tests/server/dataset/recording.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class JoinSession : public testing::Test {
 protected:
  /// A folder as a server leaves it, of frames that are real JPEGs.
  void record(const std::string& name, const std::vector<Sequence>& frames,
              const std::vector<Sequence>& drops,
              std::optional<std::uint64_t> captured = std::nullopt) {
    const auto store = test::open_store(folder_ / name, {"r", "s", ""});
    for (const Sequence frame : frames) {
      ASSERT_FALSE(store->write(*test::jpeg_frame_ptr(frame, 16, 16), 0));
    }
    std::vector<DropRecord> dropped;
    for (const Sequence drop : drops) {
      dropped.push_back(
          {drop, static_cast<std::int64_t>(drop) * test::kFrameNs, DropReason::kPolicy});
    }
    if (!drops.empty()) test::write_drops(*store, dropped);
    if (captured) {
      ASSERT_FALSE(store->note({wire::Stats{*captured, 0, 0, 0, 0, 0, 0}, 0}));
    }
    ASSERT_FALSE(store->finish(captured.has_value()));
    folders_.push_back(folder_ / name);
  }
  JoinReport join() {
    const auto report = join_session(folders_, folder_ / "out");
    EXPECT_TRUE(report) << report.error().text;
    return report ? report.value() : JoinReport{};
  }
  std::vector<std::string> problems_of_out() const {
    const auto report = check_session(folder_ / "out");
    return report ? report.value().problems : std::vector<std::string>{report.error().text};
  }

  test::TemporaryFolder folder_;
  std::vector<std::filesystem::path> folders_;
};

TEST_F(JoinSession, MakesOneSoundSessionOfFoldersInAnyOrder) {
  record("b", {3, 5, 6}, {4}, 7);
  record("a", {0, 2}, {1});
  const JoinReport report = join();
  EXPECT_EQ(report.parts, 2U);
  EXPECT_EQ(report.frames, 5U);
  EXPECT_EQ(report.repeats, 0U);
  EXPECT_THAT(report.problems, IsEmpty());
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

TEST_F(JoinSession, MakesTheViewsOfWhatItHasMade) {
  record("a", {0, 2}, {1});
  record("b", {3}, {}, 4);
  join();
  EXPECT_EQ(test::read_lines(folder_ / "out/times.txt").size(), 3U);
  EXPECT_EQ(test::read_lines(folder_ / "out/checksums.sfv").size(), 3U);
  EXPECT_EQ(test::read_file(folder_ / "out/drops.csv"),
            "sequence,reason,capture_time_s\n1,policy,0.040000000\n");
}

TEST_F(JoinSession, TakesTheWholeOfAFrameThatIsReducedElsewhere) {
  for (const bool is_whole_first : {true, false}) {
    folders_.clear();
    std::filesystem::remove_all(folder_ / "out");
    const auto whole = test::jpeg_frame_ptr(0, 32, 32);
    EncodedFrame reduced = *test::jpeg_frame_ptr(0, 16, 16);
    reduced.quality = 30;
    reduced.whole_bytes = static_cast<std::uint32_t>(whole->jpeg.size());
    reduced.whole_crc = crc32(whole->jpeg);
    for (const bool is_first : {true, false}) {
      folders_.push_back(folder_ / (is_first ? "a" : "b"));
      std::filesystem::remove_all(folders_.back());
      const auto store = test::open_store(folders_.back(), {"r", "s", ""});
      ASSERT_FALSE(store->write(is_first == is_whole_first ? *whole : reduced, 0));
    }
    EXPECT_THAT(join().problems, IsEmpty());
    const auto joined = read_session(folder_ / "out");
    ASSERT_TRUE(joined);
    ASSERT_THAT(joined.value().frames, SizeIs(1));
    EXPECT_EQ(joined.value().frames[0].bytes, whole->jpeg.size());
    EXPECT_EQ(test::read_file(folder_ / "out/images/000000.jpg"), test::as_text(whole->jpeg));
  }
}

TEST_F(JoinSession, LateFramesOfAnotherServerAndTheLastAccountBelongToIt) {
  record("a", {0, 1}, {2, 3});
  const auto late = test::open_store(folder_ / "late");
  ASSERT_TRUE(late->write_late(*test::jpeg_frame_ptr(3, 16, 16), 0));
  wire::Account account;
  account.session_id = "s";
  account.is_final = true;
  account.has_ended = true;
  account.captured = 6;
  account.confirmed = 5;
  ASSERT_FALSE(late->take_account(account));
  folders_.push_back(folder_ / "late");
  EXPECT_EQ(join().frames, 3U);
  const auto report = check_session(folder_ / "out");
  ASSERT_TRUE(report);
  EXPECT_THAT(report.value().problems, IsEmpty());
  EXPECT_THAT(summary(report.value()),
              testing::StartsWith("OK: 6 captured: 2 live, 1 late, 0 on the robot, 3 dropped (1 "
                                  "policy, 1 unknown, 1 lost)"));
}

TEST_F(JoinSession, OtherStreamsAreThereOnce) {
  constexpr wire::StreamId kStream = wire::kFirstOther;
  const auto write = [&](const char* name, std::uint64_t first, std::uint64_t next) {
    const auto store = test::open_store(folder_ / name, {"r", "s", ""});
    ASSERT_FALSE(store->write_items({kStream, first, next, {1, 2, 3}}));
    folders_.push_back(folder_ / name);
  };
  write("a", 0, 10);
  write("b", 8, 10);  // a repeat
  join();
  std::vector<std::uint64_t> firsts;
  ASSERT_FALSE(read_items(folder_ / "out", [&](const RecordedItems& items) {
    if (items.stream == kStream) firsts.push_back(items.first);
  }));
  EXPECT_THAT(firsts, testing::ElementsAre(0));
}

/// The first server's acknowledgement was lost, and the robot made its batches anew.
TEST_F(JoinSession, SamplesThatTwoServersHaveAreThereOnce) {
  constexpr wire::StreamId kStream = wire::kFirstOther;
  const std::vector<wire::StreamDeclaration> streams{{kStream, "imu0", "imu"}};
  const auto write = [&](const char* name, std::uint64_t first, std::uint64_t next) {
    std::vector<Sample> samples;
    for (auto number = first; number < next; ++number) {
      samples.push_back({static_cast<std::int64_t>(number), {}, {}});
    }
    const auto store = test::open_store(folder_ / name, {"r", "s", "", streams});
    ASSERT_FALSE(store->write_items({kStream, first, next, wire::encode_samples(samples)}));
    folders_.push_back(folder_ / name);
  };
  write("a", 0, 10);
  write("b", 7, 12);
  join();
  std::vector<std::int64_t> times;
  const auto totals = for_each_sample(folder_ / "out", streams.front(), [&](const Sample& sample) {
    times.push_back(sample.time_ns);
  });
  ASSERT_TRUE(totals);
  EXPECT_THAT(times, testing::ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11));
  EXPECT_EQ(totals.value().lost(), 0U);
}

/// A server that never had the session live knows neither its calibration nor its clock.
TEST_F(JoinSession, WhatIsKnownOfTheLiveStreamStaysWithAPartOfLateFramesOnly) {
  const std::string calibration = "Pinhole 0.5 0.5 0.5 0.5 0\n16 16\ncrop\n16 16\n";
  const auto live = test::open_store(folder_ / "live", {"r", "s", calibration});
  ASSERT_FALSE(live->write(*test::jpeg_frame_ptr(0, 16, 16), 0));
  ASSERT_FALSE(live->note({wire::Stats{2, 0, 0, 0, 0, 0, 0}, 5}));
  const auto late = test::open_store(folder_ / "late");
  ASSERT_TRUE(late->write_late(*test::jpeg_frame_ptr(1, 16, 16), 0));
  folders_ = {folder_ / "live", folder_ / "late"};
  join();
  const auto joined = read_session(folder_ / "out");
  ASSERT_TRUE(joined);
  EXPECT_EQ(joined.value().summary.info.calibration, calibration);
  EXPECT_EQ(joined.value().summary.closing.clock_offset_ns, 5);
  EXPECT_TRUE(joined.value().summary.closing.stats);
}

TEST_F(JoinSession, WhatTheServerBeforeHadNotYetAcknowledgedIsThereOnce) {
  record("a", {0, 1, 2, 3}, {});
  record("b", {2, 3, 4}, {}, 5);
  const JoinReport report = join();
  EXPECT_EQ(report.frames, 5U);
  EXPECT_EQ(report.repeats, 2U);
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

TEST_F(JoinSession, ADropRecordOfAFrameThatAFolderHasIsSettled) {
  record("a", {0, 1, 2}, {});
  record("b", {3}, {1, 2}, 4);
  const JoinReport report = join();
  EXPECT_EQ(report.frames, 4U);
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

TEST_F(JoinSession, ADropRecordInTwoFoldersIsThereOnce) {
  record("a", {0}, {1});
  record("b", {2}, {1}, 3);
  join();
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

/// Its server died before the first record, and the robot went on elsewhere.
TEST_F(JoinSession, AFolderWithoutAJournalIsNoPart) {
  record("a", {0, 1}, {});
  folders_.push_back(folder_ / "b");
  std::filesystem::create_directories(folders_.back() / "images");
  record("c", {2}, {}, 3);
  EXPECT_EQ(join().parts, 2U);
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

/// A power cut keeps the record of a frame, and not the image.
TEST_F(JoinSession, AFrameWhoseImageAPowerCutTookIsNotThere) {
  for (const bool has_other : {true, false}) {
    folders_ = {folder_ / "a"};
    for (const char* const made : {"out", "a", "b"}) std::filesystem::remove_all(folder_ / made);
    {
      const auto store = test::open_store(folders_.back(), {"r", "s", ""});
      for (const Sequence frame : {0U, 1U, 2U}) {
        ASSERT_FALSE(store->write(*test::jpeg_frame_ptr(frame, 16, 16), 0));
      }
    }  // as a kill
    std::filesystem::resize_file(folder_ / "a/images/000001.jpg", 5);
    std::filesystem::remove(folder_ / "a/images/000002.jpg");
    if (has_other) record("b", {1, 2}, {}, 3);
    if (!has_other) record("b", {}, {1, 2}, 3);
    EXPECT_EQ(join().frames, has_other ? 3U : 1U);
    EXPECT_THAT(problems_of_out(), IsEmpty());
  }
}

TEST_F(JoinSession, WithoutAnyJournalThereIsNoSession) {
  for (const char* name : {"a", "b"}) {
    folders_.push_back(folder_ / name);
    std::filesystem::create_directories(folders_.back());
  }
  const auto joined = join_session(folders_, folder_ / "out");
  ASSERT_FALSE(joined);
  EXPECT_THAT(joined.error().text, HasSubstr("no journal in any of the 2 folders"));
}

TEST_F(JoinSession, FramesWithDifferentBytesAreAProblem) {
  record("a", {0, 1}, {});
  EncodedFrame other = *test::jpeg_frame_ptr(7, 16, 16);
  other.sequence = 1;
  other.capture_time_ns = test::kFrameNs;
  ASSERT_FALSE(test::open_store(folder_ / "b", {"r", "s", ""})->write(other, 0));
  folders_.push_back(folder_ / "b");
  EXPECT_THAT(join().problems, SizeIs(1));
}

/// At another server the robot sends again what was not acknowledged, perhaps in another quality.
TEST_F(JoinSession, FramesOfOneImageInOtherQualitiesAreNoProblem) {
  const auto reduced = [](Sequence sequence, std::uint8_t quality, std::uint32_t whole_crc) {
    EncodedFrame frame = *test::jpeg_frame_ptr(sequence + quality, 16, 16);
    frame.sequence = sequence;
    frame.capture_time_ns = static_cast<std::int64_t>(sequence) * test::kFrameNs;
    frame.quality = quality;
    frame.whole_bytes = static_cast<std::uint32_t>(test::jpeg_frame_ptr(1, 16, 16)->jpeg.size());
    frame.whole_crc = whole_crc;
    return frame;
  };
  const auto first = test::open_store(folder_ / "a", {"r", "s", ""});
  const auto second = test::open_store(folder_ / "b", {"r", "s", ""});
  ASSERT_FALSE(first->write(*test::jpeg_frame_ptr(1, 16, 16), 0));
  ASSERT_FALSE(second->write(reduced(1, 30, test::jpeg_frame_ptr(1, 16, 16)->jpeg_crc), 0));
  ASSERT_FALSE(first->write(reduced(2, 50, 0x0A1B2C3D), 0));
  ASSERT_FALSE(second->write(reduced(2, 30, 0x0A1B2C3D), 0));
  ASSERT_FALSE(first->write(reduced(3, 50, 0x0A1B2C3D), 0));
  ASSERT_FALSE(second->write(reduced(3, 30, 0x0A1B2C3E), 0));  // of another image
  folders_ = {folder_ / "a", folder_ / "b"};
  const auto problems = join().problems;
  ASSERT_THAT(problems, SizeIs(1));
  EXPECT_THAT(problems[0], HasSubstr("frame 3: "));
}

TEST_F(JoinSession, AMissingFolderIsFoundByTheCheck) {
  record("a", {0, 1}, {});
  record("c", {5}, {}, 6);
  join();
  EXPECT_THAT(problems_of_out(), testing::ElementsAre(HasSubstr("among: frames 2 to 4")));
}

TEST_F(JoinSession, DoesNotWriteIntoAFolderThatHasSomething) {
  record("a", {0}, {});
  std::filesystem::create_directories(folder_ / "out/images");
  EXPECT_FALSE(join_session(folders_, folder_ / "out"));
  EXPECT_FALSE(join_session({}, folder_ / "other"));
}

}  // namespace
}  // namespace orbbuf
