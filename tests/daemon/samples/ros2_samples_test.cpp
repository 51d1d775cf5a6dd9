// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/ros2_samples.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <optional>
#include <vector>

#include "daemon/samples/sample_streams.hpp"
#include "testing/captured_log.hpp"
#include "testing/loopback_dds.hpp"
#include "tests/daemon/topics/topic_writer.hpp"

namespace orbbuf {
namespace {

using test::TopicWriter;
using testing::ElementsAre;
using testing::SizeIs;

const std::string kImuTopic = "/imu/data";

class Ros2SamplesTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { test::use_loopback_dds("78"); }

  void make() {
    source_.emplace(io_, settings_, [this](const Sample& sample) { samples_.push_back(sample); });
    writer_.emplace(sensor_msgs_msg_dds__Imu__desc, kImuTopic);
    while (!writer_->reader()) io_.run_one();
  }
  void write(std::int32_t sec, double x) {
    sensor_msgs_msg_dds__Imu_ imu{};
    imu.header = test::header(sec, 7);
    imu.orientation = {9, 9, 9, 9};
    imu.angular_velocity = {x, 2, 3};
    imu.linear_acceleration = {4, 5, 6};
    writer_->write(&imu);
  }
  void run_until(std::size_t samples) {
    while (samples_.size() < samples) io_.run_one();
  }

  SampleStreamSettings settings_{"imu0", "ros2", {}, 1U << 20U, {}, kImuTopic};
  boost::asio::io_context io_;
  std::vector<Sample> samples_;
  std::optional<Ros2Samples> source_;
  std::optional<TopicWriter> writer_;
};

TEST_F(Ros2SamplesTest, AMessageIsASampleWithItsStamp) {
  make();
  write(1'700'000'000, 1);
  write(1'700'000'001, -1);
  run_until(2);
  EXPECT_THAT(samples_, ElementsAre(Sample{1'700'000'000'000'000'007, {1, 2, 3}, {4, 5, 6}},
                                    Sample{1'700'000'001'000'000'007, {-1, 2, 3}, {4, 5, 6}}));
}

TEST_F(Ros2SamplesTest, WhatIsNotFiniteIsIgnoredAndLoggedOnce) {
  const test::CapturedLog log;
  make();
  write(1, std::nan(""));
  write(2, HUGE_VAL);
  write(3, 1);
  run_until(1);
  EXPECT_EQ(samples_[0].time_ns, 3'000'000'007);
  EXPECT_THAT(log.lines("imu0: a message of topic /imu/data is ignored"), SizeIs(1));
}

TEST_F(Ros2SamplesTest, MessagesOfATopicAreTakenAsTheyAreAndAsOftenAsTheRateAllows) {
  settings_.kind = "topic";
  settings_.rate = 1e-3;
  make();
  write(1, 5);
  run_until(1);
  const TopicMessage& message = *samples_[0].message;
  EXPECT_EQ(message.publisher->type, "sensor_msgs::msg::dds_::Imu_");
  EXPECT_EQ(message.cdr.at(4), 1);  // the stamp's seconds
  EXPECT_EQ(samples_[0].time_ns, message.time_ns);
  write(2, 5);
  io_.run_for(std::chrono::milliseconds(1500));  // it looks each second
  EXPECT_EQ(samples_.size(), 1U);
}

TEST_F(Ros2SamplesTest, AMessageOfATopicWaitsForNoOther) {
  settings_.kind = "topic";
  int due = 0;
  SampleStreams streams(io_, {settings_}, [&due] { ++due; });
  writer_.emplace(sensor_msgs_msg_dds__Imu__desc, kImuTopic);
  while (!writer_->reader()) io_.run_one();
  write(1, 5);
  while (due == 0) io_.run_one();
  EXPECT_TRUE(streams.take_batch());
  EXPECT_FALSE(streams.take_batch());
}

TEST_F(Ros2SamplesTest, NothingRunsAfterItsEnd) {
  make();
  write(1, 1);
  io_.poll_one();  // may queue what comes next
  const auto before = samples_.size();
  source_.reset();
  io_.run();
  EXPECT_EQ(samples_.size(), before);
}

}  // namespace
}  // namespace orbbuf
