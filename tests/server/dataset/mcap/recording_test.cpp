// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/recording.hpp"

#include <gmock/gmock.h>

#include <limits>

#include "tests/server/dataset/mcap/contents.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::plain_frame;
using test::plain_pair;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

const std::string kPinhole = "Pinhole 10 10 2 2 0\n4 4\nnone\n4 4\n";

class McapRecordingTest : public testing::Test {
 protected:
  mcap::Recording create(const std::string& calibration = "") const {
    auto recording = mcap::Recording::create(path_, {"r1", "s1", calibration, {}});
    EXPECT_TRUE(recording);
    return std::move(recording).value();
  }
  test::McapContents finished(mcap::Recording& recording, std::int64_t clock_offset_ns = 0) const {
    EXPECT_FALSE(recording.finish(clock_offset_ns));
    return test::read_mcap(path_);
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "s1.mcap";
};

TEST_F(McapRecordingTest, DescribesWhatItHasMessagesOf) {
  auto out = create(kPinhole);
  for (Sequence i = 0; i < 5; ++i) EXPECT_TRUE(out.add(plain_frame(i)));
  const auto found = finished(out);
  EXPECT_THAT(found.topics,
              ElementsAre(testing::Pair(1, "/r1/image"), testing::Pair(2, "/r1/calibration")));
  EXPECT_THAT(found.of("/r1/image"), ElementsAre(0, 1, 2, 3, 4));
  EXPECT_THAT(found.of("/r1/calibration"), ElementsAre(0, 1, 2, 3, 4));
  EXPECT_THAT(found.data_of("/r1/image").at(3), HasSubstr(test::as_text(plain_frame(3).jpeg)));
}

TEST_F(McapRecordingTest, TheRightCalibrationNeedsTheBaseline) {
  for (const bool has_baseline : {false, true}) {
    auto out = create(kPinhole + (has_baseline ? "0.5\n" : ""));
    EXPECT_TRUE(out.add(plain_pair(7, 10, 10)));
    const auto found = finished(out);
    EXPECT_THAT(found.of("/r1/left/calibration"), ElementsAre(7));
    EXPECT_EQ(found.of("/r1/right/calibration").size(), has_baseline ? 1U : 0U);
    EXPECT_THAT(found.data_of("/r1/left/image").at(0),
                HasSubstr(test::as_text(plain_pair(7, 10, 10).left())));
    EXPECT_THAT(found.data_of("/r1/right/image").at(0),
                HasSubstr(test::as_text(plain_pair(7, 10, 10).right())));
  }
}

TEST_F(McapRecordingTest, SaysWhyThereIsNoCalibration) {
  EXPECT_EQ(create().problem(), "");
  auto out = create("FOV 1 1 0.5 0.5 0.9\n4 4\nnone\n4 4\n");
  EXPECT_THAT(out.problem(), HasSubstr("FOV"));
  EXPECT_TRUE(out.add(plain_frame(0)));
  EXPECT_THAT(finished(out).of("/r1/calibration"), IsEmpty());
}

TEST_F(McapRecordingTest, SaysByHowMuchTheRobotsClockWasSet) {
  auto out = create();
  EXPECT_TRUE(out.add(plain_frame(0)));
  EXPECT_EQ(finished(out, -3'600'000'000'000).records.at(0x0C), 1);
  EXPECT_THAT(test::read_file(path_), HasSubstr("-3600000000000"));
  auto without = create();
  EXPECT_TRUE(without.add(plain_frame(0)));
  finished(without);
  EXPECT_THAT(test::read_file(path_), Not(HasSubstr("orbbuf.clock")));
}

TEST_F(McapRecordingTest, QualitiesAreJson) {
  auto out = create();
  EXPECT_TRUE(out.add(plain_frame(0)));
  auto whole = plain_frame(1);
  whole.quality = 80;
  EXPECT_TRUE(out.add(whole));
  EXPECT_TRUE(out.add(test::reduced_frame(2)));
  const auto found = finished(out);
  EXPECT_THAT(found.of("/r1/quality"), ElementsAre(1, 2));
  EXPECT_THAT(found.data_of("/r1/quality"),
              ElementsAre(R"({"timestamp":{"sec":0,"nsec":40000000},"sequence":1,"quality":80})",
                          HasSubstr(R"("quality":30,"whole_bytes":40123,"whole_crc":169552957})")));
}

TEST_F(McapRecordingTest, OfARangeOfDropsEachFrameIsAMessage) {
  auto out = create();
  EXPECT_TRUE(out.add(DropRecord{4, 1'633'012'000, DropReason::kPolicy, 17}));
  EXPECT_TRUE(out.add(DropRecord{6, 0, DropReason::kBusy, kUnknownSimilarity, 3, 80}));
  const auto found = finished(out);
  EXPECT_THAT(found.of("/r1/drops"), ElementsAre(4, 6, 7, 8));
  EXPECT_THAT(found.data_of("/r1/drops"),
              ElementsAre(R"({"timestamp":{"sec":1,"nsec":633012000},"sequence":4,)"
                          R"("reason":"policy","similarity":17})",
                          R"({"timestamp":{"sec":0,"nsec":0},"sequence":6,"reason":"busy"})",
                          R"({"timestamp":{"sec":0,"nsec":40},"sequence":7,"reason":"busy"})",
                          R"({"timestamp":{"sec":0,"nsec":80},"sequence":8,"reason":"busy"})"));
}

TEST_F(McapRecordingTest, TimesBefore1970AndNumbersBeyond32BitsAreNoMatter) {
  auto out = create();
  auto frame = plain_frame((Sequence{1} << 32) + 5);
  frame.capture_time_ns = -1;
  EXPECT_TRUE(out.add(frame));
  EXPECT_TRUE(out.add(plain_frame((Sequence{1} << 32) + 6)));
  const auto found = finished(out);
  EXPECT_THAT(found.of("/r1/image"), ElementsAre(5, 6));
  ASSERT_FALSE(found.chunk_times.empty());
  EXPECT_EQ(found.chunk_times[0].first, 0U);
}

class Ros2RecordingTest : public McapRecordingTest {
 protected:
  static constexpr wire::StreamId kOdom = wire::kFirstOther + 1;

  mcap::Recording create() const {
    auto recording = mcap::Recording::create(
        path_,
        {"r-1", "s1", kPinhole, {{wire::kFirstOther, "imu0", "imu"}, {kOdom, "odom", "ros2"}}});
    EXPECT_TRUE(recording);
    return std::move(recording).value();
  }
  static RecordedItems message_of(std::uint64_t number, const std::string& type) {
    TopicPublisher publisher;
    publisher.topic = "/odom";
    publisher.type = type;
    TopicMessage message{std::make_shared<const TopicPublisher>(publisher), 7, {0, 1, 0, 0, 'x'}};
    const Sample sample{7, {}, {}, std::make_shared<const TopicMessage>(std::move(message))};
    return {kOdom, number, number + 1, wire::encode_samples({&sample, 1})};
  }
};

TEST_F(Ros2RecordingTest, ASessionWithTopicsIsOneOfRos2) {
  auto out = create();
  EXPECT_TRUE(out.add(plain_frame(2)));
  EXPECT_TRUE(out.add(message_of(5, "nav_msgs::msg::dds_::Odometry_")));
  EXPECT_TRUE(out.add(message_of(6, "my_msgs::msg::dds_::Any_")));
  EXPECT_TRUE(out.add(wire::kFirstOther, 3, Sample{1, {}, {}}));
  EXPECT_TRUE(out.add(DropRecord{3, 0, DropReason::kPolicy, 0}));
  const auto found = finished(out);
  std::vector<std::string> topics;
  for (const auto& [channel, name] : found.topics) topics.push_back(name);
  EXPECT_THAT(topics, ElementsAre("/r_1/image_raw/compressed", "/r_1/camera_info", "/r_1/imu0",
                                  "/odom", "/odom"));
  EXPECT_THAT(found.of("/r_1/image_raw/compressed"), ElementsAre(2));
  EXPECT_THAT(found.data_of("/r_1/image_raw/compressed").at(0),
              HasSubstr(test::as_text(plain_frame(2).jpeg)));
  EXPECT_THAT(found.data_of("/odom").at(0), std::string("\0\1\0\0x", 5));
  EXPECT_THAT(found.of("/r_1/imu0"), ElementsAre(3));
  const std::string file = test::read_file(path_);
  EXPECT_THAT(file.substr(8), HasSubstr("ros2"));
  EXPECT_THAT(file, HasSubstr("nav_msgs/msg/Odometry"));
  EXPECT_THAT(file, HasSubstr("MSG: geometry_msgs/Quaternion\nfloat64 x"));
  EXPECT_THAT(file, HasSubstr("my_msgs/msg/Any"));
  EXPECT_THAT(file, Not(HasSubstr("protobuf")));
  EXPECT_THAT(file, Not(HasSubstr("json")));
}

}  // namespace
}  // namespace orbbuf
