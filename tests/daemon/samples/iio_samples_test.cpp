// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/iio_samples.hpp"

#include <gmock/gmock.h>
#include <unistd.h>

#include <stdexcept>

#include "tests/daemon/samples/iio_tree.hpp"

namespace orbbuf {
namespace {

using test::IioTree;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::ThrowsMessage;

class IioSamplesTest : public ::testing::Test {
 protected:
  void add(int number, const std::string& name, const std::vector<std::string>& types) {
    auto files = IioTree::device(name);
    int index = 0;
    for (const std::string& type : types) {
      IioTree::add_sensor(files, type, index, "1");
      index += 3;
    }
    tree_.add(number, files);
    nodes_[number] = tree_.open_node(number);
  }
  void send(int number, const std::vector<int>& words, std::int64_t after_ms) {
    const auto scan = IioTree::scan(words, begin_ns_ + after_ms * kMs);
    ASSERT_EQ(::write(nodes_.at(number).get(), scan.data(), scan.size()),
              static_cast<ssize_t>(scan.size()));
  }
  std::unique_ptr<IioSamples> open(std::vector<std::string> devices) {
    SampleStreamSettings settings{"imu0", "iio"};
    settings.devices = std::move(devices);
    return std::make_unique<IioSamples>(
        io_, settings, [this](const Sample& sample) { samples_.push_back(sample); }, tree_.roots());
  }

  static constexpr std::int64_t kMs = 1'000'000;
  const ClockReading clocks_ = read_clocks();
  const std::int64_t begin_ns_ = clocks_.monotonic_ns - 1000 * kMs;
  IioTree tree_;
  std::map<int, UniqueFd> nodes_;
  boost::asio::io_context io_;
  std::vector<Sample> samples_;
};

TEST_F(IioSamplesTest, ComeFromOneDeviceWithTheKernelsStamps) {
  add(0, "mpu6050", {"accel", "anglvel"});
  const auto source = open({"mpu6050"});
  send(0, {1, 2, 3, 4, 5, 6}, 0);
  send(0, {1, 2, 3, 4, 5, 6}, 5);
  while (samples_.size() < 2) io_.run_one();
  EXPECT_THAT(samples_[0].linear_acceleration, ElementsAre(1, 2, 3));
  EXPECT_THAT(samples_[0].angular_velocity, ElementsAre(4, 5, 6));
  EXPECT_EQ(samples_[1].time_ns - samples_[0].time_ns, 5 * kMs);
  const std::int64_t utc_ns = begin_ns_ + clocks_.utc_ns - clocks_.monotonic_ns;
  EXPECT_NEAR(static_cast<double>(samples_[0].time_ns - utc_ns), 0, 0.1 * kMs);
}

TEST_F(IioSamplesTest, OfTwoDevicesHaveTheAccelerationAtTheGyroscopesTime) {
  add(0, "accel_3d", {"accel"});
  add(1, "gyro_3d", {"anglvel"});
  const auto source = open({"gyro_3d", "accel_3d"});
  send(1, {7, 7, 7}, 0);  // no acceleration before it
  while (io_.poll_one() > 0) {
  }
  send(0, {100, 0, -100}, 10);
  while (io_.poll_one() > 0) {
  }
  for (const std::int64_t time : {11, 14, 19, 21}) send(1, {static_cast<int>(time), 0, 0}, time);
  while (io_.poll_one() > 0) {
  }
  EXPECT_TRUE(samples_.empty()) << "they wait for the acceleration after them";
  send(0, {200, 0, 0}, 20);
  while (samples_.size() < 3) io_.run_one();
  std::vector<double> x;
  std::vector<double> z;
  for (const Sample& sample : samples_) {
    x.push_back(std::round(sample.linear_acceleration[0]));
    z.push_back(std::round(sample.linear_acceleration[2]));
  }
  EXPECT_THAT(x, ElementsAre(110, 140, 190));
  EXPECT_THAT(z, ElementsAre(-90, -60, -10));
  EXPECT_THAT(samples_[1].angular_velocity, ElementsAre(14, 0, 0));
}

/// Which would hold up, or spoil, all until its time. One of the gyroscope is counted by its
/// stream.
TEST_F(IioSamplesTest, AStampOfTheFutureIsOfNoSample) {
  add(0, "accel_3d", {"accel"});
  add(1, "gyro_3d", {"anglvel"});
  const auto source = open({"gyro_3d", "accel_3d"});
  const auto receive = [this](int number, std::int64_t time) {
    send(number, {static_cast<int>(time % 1000), 0, 0}, time);
    while (io_.poll_one() > 0) {
    }
  };
  receive(0, 10);
  receive(1, 1'000'000'011);
  receive(1, 12);
  receive(0, 1'000'000'013);
  receive(0, 20);
  ASSERT_EQ(samples_.size(), 2U);
  EXPECT_EQ(samples_[0].time_ns, 0);
  EXPECT_THAT(samples_[1].angular_velocity, ElementsAre(12, 0, 0));
  EXPECT_NEAR(samples_[1].linear_acceleration[0], 12, 0.01);
}

/// The clock may have been set between the two: times of before it would hold up those behind it.
TEST_F(IioSamplesTest, BeginAnewAtTheFirstFrame) {
  add(0, "accel_3d", {"accel"});
  add(1, "gyro_3d", {"anglvel"});
  const auto source = open({"gyro_3d", "accel_3d"});
  const auto receive = [this](int number, int time) {
    send(number, {time, 0, 0}, time);
    while (io_.poll_one() > 0) {
    }
  };
  receive(0, 10);
  receive(1, 11);
  source->on_frame(0);
  receive(0, 20);
  receive(1, 21);
  source->on_frame(1);
  receive(0, 30);
  ASSERT_EQ(samples_.size(), 1U);
  EXPECT_THAT(samples_[0].angular_velocity, ElementsAre(21, 0, 0));
}

TEST_F(IioSamplesTest, NeedAGyroscopeAndAnAccelerometer) {
  add(0, "accel_3d", {"accel"});
  const auto open_accelerometer = [this] { open({"accel_3d"}); };
  EXPECT_THAT(open_accelerometer, ThrowsMessage<std::runtime_error>(HasSubstr(
                                      "imu0: accel_3d: expected one gyroscope and one acc")));
  EXPECT_EQ(tree_.get(0, "buffer/enable"), "0");
  const auto open_none = [this] { open({"bmi160"}); };
  EXPECT_THAT(open_none,
              ThrowsMessage<std::runtime_error>(HasSubstr("imu0: no IIO device bmi160")));
}

}  // namespace
}  // namespace orbbuf
