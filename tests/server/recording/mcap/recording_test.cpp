// SPDX-License-Identifier: Apache-2.0
#include "server/recording/mcap/recording.hpp"

#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include <cstdint>
#include <limits>

#include "server/recording/late_files.hpp"
#include "server/recording/session_files.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::plain_frame;
using test::plain_pair;

const std::string kPinhole = "Pinhole 100 101 80 60 0\n160 120\nnone\n160 120\n";

class McapRecordingTest : public testing::Test {
 protected:
  mcap::Recording recording(const std::string& calibration = "") const {
    return {path_, {"r1", "s1", calibration}};
  }
  /// Where a recording stands that is taken up again.
  wire::Position recovered(const std::optional<wire::Position>& files = std::nullopt) const {
    auto again = recording();
    const auto position = again.recover(files);
    EXPECT_TRUE(position);
    return position ? position.value() : wire::Position{};
  }
  static std::optional<Error> finish(mcap::Recording& recording,
                                     std::optional<std::int64_t> clock_offset_ns = std::nullopt) {
    SessionClosing closing{true, std::nullopt, clock_offset_ns};
    return recording.finish(closing);
  }
  std::string content() const { return test::read_file(path_); }
  std::size_t count(const std::string& text) const {
    const std::string all = content();
    std::size_t found = 0;
    for (auto at = all.find(text); at != std::string::npos; at = all.find(text, at + 1)) ++found;
    return found;
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "r1/s1/s1.mcap";
};

TEST_F(McapRecordingTest, RemembersHowFarItGot) {
  auto out = recording();
  EXPECT_FALSE(out.write(plain_frame(3)));
  EXPECT_FALSE(out.write_drops({0, {{4, 0}, {5, 0}}}));
  EXPECT_EQ(recovered(), (wire::Position{4, 2}));
  EXPECT_FALSE(out.write(plain_pair(9, 10, 10)));
  EXPECT_EQ(recovered(), (wire::Position{10, 2}));
  EXPECT_FALSE(finish(out));
  EXPECT_EQ(recovered(), (wire::Position{10, 2}));
}

TEST_F(McapRecordingTest, DescribesWhatItHasMessagesOfAndOnce) {
  auto out = recording(kPinhole);
  for (Sequence i = 0; i < 5; ++i) EXPECT_FALSE(out.write(plain_frame(i)));
  auto again = recording(kPinhole);
  EXPECT_TRUE(again.recover(std::nullopt));
  EXPECT_FALSE(again.write(plain_frame(5)));
  for (const char* topic : {"/r1/image", "/r1/calibration"}) EXPECT_EQ(count(topic), 1U) << topic;
  for (const char* topic : {"/r1/left", "/r1/right", "/r1/drops"}) EXPECT_EQ(count(topic), 0U);
}

TEST_F(McapRecordingTest, TheRightCalibrationNeedsTheBaseline) {
  EXPECT_FALSE(recording(kPinhole).write(plain_pair(0, 10, 10)));
  EXPECT_EQ(count("/r1/left/calibration"), 1U);
  EXPECT_EQ(count("/r1/right/calibration"), 0U);
  std::filesystem::remove(path_);
  EXPECT_FALSE(recording(kPinhole + "0.5\n").write(plain_pair(0, 10, 10)));
  EXPECT_EQ(count("/r1/right/calibration"), 1U);
}

TEST_F(McapRecordingTest, SaysWhyThereIsNoCalibration) {
  const test::CapturedLog log;
  EXPECT_FALSE(recording("FOV 1 1 0.5 0.5 0.9\n4 4\nnone\n4 4\n").write(plain_frame(0)));
  EXPECT_FALSE(recording("my camera\n").write(plain_frame(1)));
  EXPECT_EQ(count("calibration"), 0U);
  EXPECT_EQ(log.lines("r1 s1: recorded without calibration: camera.txt: FOV is no").size(), 1U);
  EXPECT_EQ(log.lines("without calibration").size(), 2U);
}

TEST_F(McapRecordingTest, SaysByHowMuchTheRobotsClockWasSet) {
  auto out = recording();
  EXPECT_FALSE(out.write(plain_frame(0)));
  EXPECT_FALSE(finish(out, 0));
  EXPECT_EQ(count("orbbuf.clock"), 0U);
  EXPECT_FALSE(finish(out, -3'600'000'000'000));
  EXPECT_EQ(count("orbbuf.clock"), 2U);  // the record, and its place in the summary
  EXPECT_EQ(count("-3600000000000"), 1U);
  EXPECT_FALSE(out.write(plain_frame(1)));
  EXPECT_EQ(count("orbbuf.clock"), 0U);
  EXPECT_EQ(recovered(), (wire::Position{2, 0}));
}

TEST_F(McapRecordingTest, QualitiesAreJson) {
  auto out = recording();
  EXPECT_FALSE(out.write(plain_frame(0)));
  EXPECT_EQ(count("/r1/quality"), 0U);
  auto whole = plain_frame(1);
  whole.quality = 80;
  EXPECT_FALSE(out.write(whole));
  EXPECT_FALSE(out.write(test::reduced_frame(2)));
  EXPECT_EQ(count("/r1/quality"), 1U);
  EXPECT_EQ(count("{\"timestamp\":{\"sec\":0,\"nsec\":40000000},\"sequence\":1,\"quality\":80}"),
            1U);
  EXPECT_EQ(count("\"sequence\":2,\"quality\":30,\"whole_bytes\":40123,\"whole_crc\":169552957}"),
            1U);
  EXPECT_FALSE(finish(out));
  EXPECT_EQ(count("/r1/quality"), 2U);  // and in the summary
}

TEST_F(McapRecordingTest, AQualityGoesWithItsFrame) {
  auto out = recording();
  for (Sequence i = 0; i < 3; ++i) EXPECT_FALSE(out.write(test::reduced_frame(i)));
  auto again = recording();
  ASSERT_EQ(again.recover(wire::Position{2, 0}).value(), (wire::Position{2, 0}));
  EXPECT_FALSE(again.write(test::reduced_frame(2, 50)));
  EXPECT_EQ(count("\"sequence\":2,\"quality\":30"), 0U);
  EXPECT_EQ(count("\"sequence\":2,\"quality\":50"), 1U);
}

TEST_F(McapRecordingTest, DropsAreJson) {
  auto out = recording();
  EXPECT_FALSE(
      out.write_drops({0,
                       {{4, 1'633'012'000, DropReason::kPolicy, 17},
                        {6, -1, DropReason::kBusy},
                        {7, std::numeric_limits<std::int64_t>::min(), DropReason::kFailed}}}));
  EXPECT_EQ(count(R"({"timestamp":{"sec":1,"nsec":633012000},"sequence":4,)"
                  R"("reason":"policy","similarity":17})"),
            1U);
  EXPECT_EQ(count(R"({"timestamp":{"sec":-1,"nsec":999999999},"sequence":6,"reason":"busy"})"), 1U);
  EXPECT_EQ(count(R"({"timestamp":{"sec":-9223372037,"nsec":145224192},"sequence":7,)"
                  R"("reason":"failed"})"),
            1U);
}

TEST_F(McapRecordingTest, WhatTheFilesLackWasNotAcknowledgedAndGoes) {
  auto out = recording();
  for (Sequence i = 0; i < 3; ++i) EXPECT_FALSE(out.write(plain_pair(i, 10, 10)));
  EXPECT_EQ(recovered(wire::Position{2, 0}), (wire::Position{2, 0}));
  EXPECT_EQ(recovered(wire::Position{3, 0}), (wire::Position{3, 0}));
  EXPECT_FALSE(out.write_drops({0, {{3, 0}, {4, 0}}}));
  EXPECT_EQ(recovered(wire::Position{3, 0}), (wire::Position{3, 0}));
  EXPECT_EQ(recovered(wire::Position{3, 2}), (wire::Position{3, 2}));
}

TEST_F(McapRecordingTest, ReachesAsFarAsTheHighestNumberInAnyOrder) {
  auto out = recording();
  for (const Sequence i : {0U, 1U, 9U}) EXPECT_FALSE(out.write(plain_frame(i)));
  for (const Sequence i : {4U, 5U}) EXPECT_FALSE(out.write_late(plain_frame(i)));
  EXPECT_EQ(recovered(), (wire::Position{10, 0}));
  EXPECT_EQ(recovered(wire::Position{10, 0}), (wire::Position{10, 0}));
}

TEST_F(McapRecordingTest, SaysWhichLateFramesItHas) {
  auto out = recording();
  for (Sequence i = 0; i < 60; i += 3) EXPECT_FALSE(out.write(plain_pair(i, 10, 10)));
  EXPECT_FALSE(out.write_drops({0, {{1, plain_frame(1).capture_time_ns, DropReason::kPolicy}}}));
  EXPECT_FALSE(out.write_late(plain_pair(4, 10, 10)));
  LateList late(5);
  const Sequence numbers[] = {1, 3, 4, 57, 60};
  for (std::size_t i = 0; i < late.size(); ++i) {
    late[i].sequence = numbers[i];
    late[i].capture_time_ns = plain_frame(numbers[i]).capture_time_ns;
  }
  const auto found = out.frames_among(late);
  ASSERT_TRUE(found);
  EXPECT_EQ(found.value().runs(), (std::map<Sequence, Sequence>{{3, 5}, {57, 58}}));
}

TEST_F(McapRecordingTest, WhatCameLateIsNoLeftoverOfAKill) {
  auto out = recording();
  for (const Sequence i : {0U, 1U, 2U}) EXPECT_FALSE(out.write(plain_frame(i)));
  for (const Sequence i : {5U, 6U}) EXPECT_FALSE(out.write_late(plain_frame(i)));
  ASSERT_TRUE(LateFiles(path_.parent_path()).write(plain_frame(5), 0));
  EXPECT_EQ(recovered(wire::Position{3, 0}), (wire::Position{6, 0}));  // and without number 6
}

TEST_F(McapRecordingTest, WhenTheFilesAreGoneTheRecordingIsKept) {
  auto out = recording();
  for (Sequence i = 0; i < 60; ++i) EXPECT_FALSE(out.write(plain_frame(i)));  // 2.4 s
  EXPECT_EQ(recovered(wire::Position{}), (wire::Position{60, 0}));
}

TEST_F(McapRecordingTest, WhatComesAgainForTheFilesIsNotRecordedAgain) {
  auto out = recording();
  EXPECT_FALSE(out.write_drops({0, {{100, 0}, {101, 0}}}));
  for (Sequence i = 0; i < 60; ++i) EXPECT_FALSE(out.write(plain_frame(i)));
  auto again = recording();
  ASSERT_EQ(again.recover(wire::Position{10, 1}).value(), (wire::Position{60, 2}));
  const std::string before = content();
  for (Sequence i = 10; i < 60; ++i) EXPECT_FALSE(again.write(plain_frame(i)));
  EXPECT_FALSE(again.write_drops({1, {{101, 0}}}));
  EXPECT_EQ(content(), before);
  EXPECT_FALSE(again.write(plain_frame(60)));
  EXPECT_FALSE(again.write_drops({1, {{101, 0}, {102, 0}}}));
  EXPECT_EQ(recovered(), (wire::Position{61, 3}));
  EXPECT_EQ(count("\"sequence\":101,"), 1U);
}

TEST_F(McapRecordingTest, WhatOnlyTheFilesHaveIsTakenFromThem) {
  SessionFiles files(path_.parent_path(), "");
  auto out = recording();
  for (Sequence i = 0; i < 10; ++i) {
    auto frame = plain_pair(i, 10, 20);
    frame.quality = 80;
    EXPECT_FALSE(files.write(frame));
    if (i >= 6) continue;
    EXPECT_FALSE(out.write(frame));
  }
  EXPECT_FALSE(files.write_drops({0, {{100, 0}, {101, 0}, {102, 0}}}));
  EXPECT_FALSE(out.write_drops({0, {{100, 0}}}));
  auto again = recording();
  ASSERT_TRUE(again.recover(wire::Position{10, 3}));
  EXPECT_FALSE(again.take_missed(path_.parent_path(), {10, 3}));
  EXPECT_EQ(recovered(wire::Position{10, 3}), (wire::Position{10, 3}));
  auto third = plain_pair(7, 10, 20);
  EXPECT_EQ(count(test::as_text(third.left())), 1U);
  EXPECT_EQ(count(test::as_text(third.right())), 1U);
  for (Sequence i = 0; i < 10; ++i) {
    EXPECT_EQ(count(fmt::format("\"sequence\":{},\"quality\":80", i)), 1U) << i;
  }
  for (const char* drop : {"100", "101", "102"}) {
    EXPECT_EQ(count("\"sequence\":" + std::string(drop) + ","), 1U) << drop;
  }
}

TEST_F(McapRecordingTest, ARecordingThatBeginsLateTakesNothingFromLongFiles) {
  const test::CapturedLog log;
  auto out = recording();
  ASSERT_TRUE(out.recover(wire::Position{1001, 0}));
  EXPECT_FALSE(out.take_missed(path_.parent_path(), {1001, 0}));
  EXPECT_EQ(log.lines("frames 0 to 1000 are in the files only").size(), 1U);
  EXPECT_FALSE(std::filesystem::exists(path_));
}

TEST_F(McapRecordingTest, ARecordingThatBeginsLateCountsDropsAsTheFilesDo) {
  auto out = recording();
  EXPECT_EQ(out.recover(wire::Position{7, 5}).value(), wire::Position{});
  EXPECT_FALSE(out.write_drops({5, {{7, 0}}}));
  EXPECT_EQ(recovered(), (wire::Position{0, 6}));
}

}  // namespace
}  // namespace orbbuf
