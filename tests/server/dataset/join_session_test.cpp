// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/join_session.hpp"

#include <gmock/gmock.h>

#include "server/dataset/check_session.hpp"
#include "server/recording/session_files.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class JoinSession : public testing::Test {
 protected:
  /// A segment as a server leaves it, of frames that are real JPEGs.
  void record(const std::string& name, const SegmentInfo& segment,
              const std::vector<Sequence>& frames, const std::vector<Sequence>& drops,
              std::optional<std::uint64_t> captured = std::nullopt) {
    SessionFiles files(folder_ / name, "", segment);
    ASSERT_TRUE(files.recover());
    for (const Sequence frame : frames) {
      ASSERT_FALSE(files.write(*test::jpeg_frame_ptr(frame, 16, 16)));
    }
    wire::Dropped dropped{segment.from.next_drop, {}};
    for (const Sequence drop : drops) {
      dropped.records.push_back(
          {drop, static_cast<std::int64_t>(drop) * test::kFrameNs, DropReason::kPolicy});
    }
    if (!drops.empty()) {
      ASSERT_FALSE(files.write_drops(dropped));
    }
    SessionClosing closing;
    closing.has_ended = captured.has_value();
    if (captured) closing.stats = wire::Stats{*captured, 0, 0, 0, 0, 0, 0};
    ASSERT_FALSE(files.finish(closing));
    segments_.push_back(folder_ / name);
  }
  JoinReport join() {
    const auto report = join_session(segments_, folder_ / "out");
    EXPECT_TRUE(report) << report.error().text;
    return report ? report.value() : JoinReport{};
  }
  std::vector<std::string> problems_of_out() const {
    const auto report = check_session(folder_ / "out");
    return report ? report.value().problems : std::vector<std::string>{report.error().text};
  }

  test::TemporaryFolder folder_;
  std::vector<std::filesystem::path> segments_;
};

TEST_F(JoinSession, MakesOneSoundSessionOfSegmentsInAnyOrder) {
  record("b", {2, {3, 1}}, {3, 5, 6}, {4}, 7);
  record("a", {}, {0, 2}, {1});
  const JoinReport report = join();
  EXPECT_EQ(report.segments, 2U);
  EXPECT_EQ(report.frames, 5U);
  EXPECT_EQ(report.repeats, 0U);
  EXPECT_THAT(report.problems, IsEmpty());
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

TEST_F(JoinSession, KeepsTheQualityOfEachFrameThatItTakes) {
  record("a", {}, {0, 1}, {});
  record("b", {2, {1, 0}}, {1, 2}, {}, 3);
  const std::string header = "sequence,quality,whole_bytes,whole_crc\n";
  test::write_file(folder_ / "a/quality.csv", header + "0,80,0,00000000\n1,80,0,00000000\n");
  test::write_file(folder_ / "b/quality.csv", header + "1,30,4000,0A1B2C3D\n");
  join();
  EXPECT_EQ(test::read_file(folder_ / "out/quality.csv"),
            header + "0,80,0,00000000\n1,30,4000,0A1B2C3D\n");
}

TEST_F(JoinSession, WhatTheOwnerBeforeHadNotYetAcknowledgedIsThereOnce) {
  record("a", {}, {0, 1, 2, 3}, {});
  record("b", {2, {2, 0}}, {2, 3, 4}, {}, 5);
  const JoinReport report = join();
  EXPECT_EQ(report.frames, 5U);
  EXPECT_EQ(report.repeats, 2U);
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

TEST_F(JoinSession, ADropRecordOfAFrameThatASegmentHasIsSettled) {
  record("a", {}, {0, 1, 2}, {});
  record("b", {2, {1, 0}}, {3}, {1, 2}, 4);
  const JoinReport report = join();
  EXPECT_EQ(report.frames, 4U);
  EXPECT_EQ(report.settled, 2U);
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

TEST_F(JoinSession, ADropRecordInTwoSegmentsIsThereOnce) {
  record("a", {}, {0}, {1});
  record("b", {2, {1, 0}}, {2}, {1}, 3);
  join();
  EXPECT_THAT(problems_of_out(), IsEmpty());
}

TEST_F(JoinSession, FramesWithDifferentBytesAreAProblem) {
  record("a", {}, {0, 1}, {});
  SessionFiles files(folder_ / "b", "", {2, {1, 0}});
  EncodedFrame other = *test::jpeg_frame_ptr(7, 16, 16);
  other.sequence = 1;
  other.capture_time_ns = test::kFrameNs;
  ASSERT_FALSE(files.write(other));
  segments_.push_back(folder_ / "b");
  EXPECT_THAT(join().problems, SizeIs(1));
}

/// After a hand-over the robot sends again what was not acknowledged, perhaps in another quality.
TEST_F(JoinSession, FramesOfOneImageInOtherQualitiesAreNoProblem) {
  record("a", {}, {0, 1, 2, 3}, {});
  SessionFiles files(folder_ / "b", "", {2, {1, 0}});
  const auto write = [&](Sequence sequence, std::uint32_t whole_crc) {
    EncodedFrame reduced = *test::jpeg_frame_ptr(sequence + 10, 16, 16);
    reduced.sequence = sequence;
    reduced.capture_time_ns = static_cast<std::int64_t>(sequence) * test::kFrameNs;
    reduced.quality = 30;
    reduced.whole_bytes = 4000;
    reduced.whole_crc = whole_crc;
    ASSERT_FALSE(files.write(reduced));
  };
  write(1, test::jpeg_frame_ptr(1, 16, 16)->jpeg_crc);
  write(2, 0x0A1B2C3D);  // of another image
  write(3, 0x0A1B2C3D);  // as in the other segment
  segments_.push_back(folder_ / "b");
  test::write_file(folder_ / "a/quality.csv",
                   "sequence,quality,whole_bytes,whole_crc\n3,50,4000,0A1B2C3D\n");
  const auto problems = join().problems;
  ASSERT_THAT(problems, SizeIs(1));
  EXPECT_THAT(problems[0], HasSubstr("frame 2: "));
}

TEST_F(JoinSession, AMissingSegmentIsFoundByTheCheck) {
  record("a", {}, {0, 1}, {});
  record("c", {3, {5, 0}}, {5}, {}, 6);
  join();
  EXPECT_THAT(problems_of_out(), testing::ElementsAre(HasSubstr("frames 2 to 4")));
}

TEST_F(JoinSession, ASegmentIsCheckedFromWhereItBegins) {
  record("b", {2, {3, 1}}, {3, 5, 6}, {4}, 7);
  const auto report = check_session(folder_ / "b");
  ASSERT_TRUE(report);
  EXPECT_THAT(report.value().problems, IsEmpty());
}

TEST_F(JoinSession, DoesNotWriteIntoAFolderThatHasSomething) {
  record("a", {}, {0}, {});
  std::filesystem::create_directories(folder_ / "out/images");
  EXPECT_FALSE(join_session(segments_, folder_ / "out"));
  EXPECT_FALSE(join_session({}, folder_ / "other"));
}

}  // namespace
}  // namespace orbbuf
