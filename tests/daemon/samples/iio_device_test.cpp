// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/iio_device.hpp"

#include <gmock/gmock.h>

#include <stdexcept>

#include "tests/daemon/samples/iio_tree.hpp"

namespace orbbuf {
namespace {

using test::IioTree;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::ThrowsMessage;

TEST(IioFormat, IsReadFromSysfs) {
  EXPECT_EQ(parse_iio_format("le:s16/32>>4"), (IioFormat{false, true, 16, 4, 4}));
  EXPECT_EQ(parse_iio_format("be:u12/16>>0"), (IioFormat{true, false, 12, 2, 0}));
  EXPECT_EQ(parse_iio_format("le:s64/64>>0"), (IioFormat{false, true, 64, 8, 0}));
  for (const char* const wrong :
       {"", "le:s16/16", "me:s16/16>>0", "le:f16/16>>0", "le:s16/24>>0", "le:s0/16>>0",
        "le:s16/16>>1", "le:s16/16X2>>0", "le:s16/16>>0 "}) {
    EXPECT_FALSE(parse_iio_format(wrong)) << wrong;
  }
}

TEST(IioFormat, SaysWhatTheBytesMean) {
  const std::array<std::uint8_t, 8> bytes{0xF1, 0xFF, 0xFF, 0x7F, 0, 0, 0, 0x80};
  EXPECT_EQ(parse_iio_format("le:s16/32>>4")->value_at(bytes.data()), -1);
  EXPECT_EQ(parse_iio_format("le:u16/32>>4")->value_at(bytes.data()), 0xFFFF);
  EXPECT_EQ(parse_iio_format("be:s16/16>>0")->value_at(bytes.data()), -0xE01);
  EXPECT_EQ(parse_iio_format("be:u12/16>>4")->value_at(bytes.data()), 0xF1F);
  EXPECT_EQ(parse_iio_format("le:s8/8>>0")->value_at(bytes.data()), -15);
  EXPECT_EQ(parse_iio_format("le:s64/64>>0")->value_at(bytes.data()),
            static_cast<std::int64_t>(0x8000'0000'7FFF'FFF1U));
}

class IioDeviceTest : public ::testing::Test {
 protected:
  /// A temperature lies before the gyroscope, as in scans of the MPU-6050.
  IioDeviceTest() {
    IioTree::add_sensor(files_, "accel", 0, "0.5");
    IioTree::add_sensor(files_, "anglvel", 4, "0.001");
    files_["scan_elements/in_temp_en"] = "0";
    files_["scan_elements/in_temp_index"] = "3";
    files_["scan_elements/in_temp_type"] = "le:s32/32>>0";
  }

  IioTree tree_;
  std::map<std::string, std::string> files_ = IioTree::device("mpu6050");
};

TEST_F(IioDeviceTest, IsSwitchedOnAndOffAgain) {
  tree_.add(3, files_);
  {
    const IioDevice device("mpu6050", tree_.roots());
    EXPECT_EQ(device.node(), tree_.roots().nodes / "iio:device3");
    EXPECT_EQ(tree_.get(3, "buffer/enable"), "1");
    EXPECT_EQ(tree_.get(3, "buffer/length"), "1024");
    EXPECT_EQ(tree_.get(3, "current_timestamp_clock"), "monotonic");
    EXPECT_EQ(tree_.get(3, "scan_elements/in_anglvel_z_en"), "1");
    EXPECT_EQ(tree_.get(3, "scan_elements/in_temp_en"), "0");
    EXPECT_TRUE(device.has_gyroscope());
    EXPECT_TRUE(device.has_accelerometer());
  }
  EXPECT_EQ(tree_.get(3, "buffer/enable"), "0");
}

TEST_F(IioDeviceTest, ReadsScansInItsUnitsAndAxes) {
  files_["in_accel_offset"] = "10";
  files_["in_accel_z_scale"] = "2";
  files_["in_anglvel_mount_matrix"] = "0, 1, 0; -1, 0, 0; 0, 0, 1";
  tree_.add(0, files_);
  const IioDevice device("iio:device0", tree_.roots());
  const auto scan = IioTree::scan({1, -2, 3, 1000, 2000, -3000}, 77);
  ASSERT_EQ(device.scan_bytes(), scan.size());
  const Sample sample = device.read(scan.data());
  EXPECT_EQ(sample.time_ns, 77);
  EXPECT_THAT(sample.linear_acceleration, ElementsAre(5.5, 4, 26));
  EXPECT_THAT(sample.angular_velocity, ElementsAre(2, -1, -3));
}

TEST_F(IioDeviceTest, ABufferThatIsOnIsTakenAsItIs) {
  for (auto& [path, text] : files_) {
    if (path.ends_with("_en")) text = "1";
  }
  files_["buffer/enable"] = "1";
  files_["current_timestamp_clock"] = "monotonic";
  tree_.add(0, files_);
  {
    const IioDevice device("mpu6050", tree_.roots());
    auto scan = IioTree::scan({1, 2, 3, 0, 4, 5, 0, 0, 0}, 0);  // the temperature at 8
    scan.at(12) = 0x03;                                         // the gyroscope at 12
    scan.at(13) = 0xE8;
    ASSERT_EQ(device.scan_bytes(), 32U);
    EXPECT_EQ(device.read(scan.data()).angular_velocity[0], 1);
    EXPECT_EQ(tree_.get(0, "buffer/length"), "2");
  }
  EXPECT_EQ(tree_.get(0, "buffer/enable"), "1");
}

TEST_F(IioDeviceTest, SaysWhyItCannotBeUsed) {
  const auto open = [this](const char* name) {
    return [=, this] { IioDevice(name, tree_.roots()); };
  };
  tree_.add(0, files_);
  EXPECT_THAT(open("bmi160"),
              ThrowsMessage<std::runtime_error>(HasSubstr("no IIO device bmi160; ")));
  tree_.put(0, "in_accel_x_scale", "?");
  EXPECT_THAT(open("mpu6050"),
              ThrowsMessage<std::runtime_error>(HasSubstr("cannot read a number from ")));
  tree_.add(0, files_);
  tree_.put(0, "in_accel_x_scale", "1");
  tree_.put(0, "buffer/enable", "1");
  EXPECT_THAT(open("mpu6050"),
              ThrowsMessage<std::runtime_error>(HasSubstr("its clock is realtime")));
  tree_.put(0, "current_timestamp_clock", "monotonic");
  EXPECT_THAT(open("mpu6050"), ThrowsMessage<std::runtime_error>(HasSubstr("no in_timestamp")));
  tree_.put(0, "scan_elements/in_temp_en", "1");
  tree_.put(0, "scan_elements/in_temp_type", "le:f32/32>>0");
  EXPECT_THAT(open("mpu6050"),
              ThrowsMessage<std::runtime_error>(HasSubstr("in_temp is le:f32/32>>0")));
  tree_.put(0, "scan_elements/in_temp_en", "0");
  std::filesystem::remove(tree_.roots().devices / "iio:device0/buffer/enable");
  std::filesystem::create_directory(tree_.roots().devices / "iio:device0/buffer/enable");
  EXPECT_THAT(open("mpu6050"), ThrowsMessage<std::runtime_error>(HasSubstr("cannot write 1 to ")));
}

TEST_F(IioDeviceTest, TheListHasTheInertialSensors) {
  EXPECT_EQ(list_iio_devices(tree_.roots()), "no inertial sensor is a device of IIO here\n");
  files_["sampling_frequency"] = "200";
  tree_.add(1, files_);
  auto accelerometer = IioTree::device("accel_3d");
  IioTree::add_sensor(accelerometer, "accel", 0, "1");
  accelerometer["in_accel_sampling_frequency"] = "100";
  tree_.add(0, accelerometer);
  tree_.add(2, {{"name", "bme280"}});
  EXPECT_EQ(list_iio_devices(tree_.roots()),
            "accel_3d (iio:device0): accelerometer 100 Hz\n"
            "mpu6050 (iio:device1): gyroscope accelerometer 200 Hz\n");
}

}  // namespace
}  // namespace orbbuf
