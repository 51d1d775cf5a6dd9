// SPDX-License-Identifier: Apache-2.0
#include "common/ros_name.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

TEST(RosName, KeepsLettersDigitsAndUnderscores) { EXPECT_EQ(ros_name("Robot_1a"), "Robot_1a"); }

TEST(RosName, HasAnUnderscoreForEveryOtherCharacter) {
  EXPECT_EQ(ros_name("lab-3.cam"), "lab_3_cam");
}

TEST(RosName, BeginsWithALetter) {
  EXPECT_EQ(ros_name("2"), "ros_2");
  EXPECT_EQ(ros_name("_a"), "ros__a");
}

TEST(RosTopic, IsAWholeName) {
  for (const char* name : {"/camera", "/_a/b_2", "/A"}) EXPECT_TRUE(is_ros_topic(name)) << name;
  for (const char* name : {"", "/", "camera", "/camera/", "//a", "/a//b", "/2", "/a b", "/a-b"}) {
    EXPECT_FALSE(is_ros_topic(name)) << name;
  }
}

TEST(RosType, IsThatOfDdsWithSlashes) {
  EXPECT_EQ(ros_type("sensor_msgs::msg::dds_::Imu_"), "sensor_msgs/msg/Imu");
}

TEST(RosFrameId, HasTheNameInPlaceOfRobot) {
  EXPECT_EQ(ros_frame_id("{robot}", "a"), "a");
  EXPECT_EQ(ros_frame_id("{robot}/camera", "a"), "a/camera");
  EXPECT_EQ(ros_frame_id("camera", "a"), "camera");
}

}  // namespace
}  // namespace orbbuf
