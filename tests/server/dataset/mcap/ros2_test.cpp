// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/ros2.hpp"

#include <gmock/gmock.h>

namespace orbbuf::mcap::ros2 {
namespace {

using testing::HasSubstr;

TEST(McapRos2, AnImageIsAsOnDds) {
  const std::uint8_t jpeg[] = {0xFF, 0xD8, 0xD9};
  EXPECT_EQ(compressed_image(1'000'000'002, "cam", jpeg),
            (Bytes{0, 1, 0, 0,                                    // CDR_LE
                   1, 0, 0, 0, 2,    0,    0,   0,                // 1 s, 2 ns
                   4, 0, 0, 0, 'c',  'a',  'm', 0,                //
                   5, 0, 0, 0, 'j',  'p',  'e', 'g', 0, 0, 0, 0,  // and padding
                   3, 0, 0, 0, 0xFF, 0xD8, 0xD9}));
}

TEST(McapRos2, NumbersAreAligned) {
  const Bytes message = imu({1, {1, 0, 0}, {}}, "camera");  // 8 + 4 + 7 bytes, then a double
  constexpr std::size_t kDoubles = 3 + 1 + 9 + 3 + 9 + 3 + 9;
  ASSERT_EQ(message.size(), 4 + 24 + kDoubles * 8);
  EXPECT_EQ(message.at(4 + 24 + 3 * 8 + 7), 0x3F);   // w: 1
  EXPECT_EQ(message.at(4 + 24 + 4 * 8 + 7), 0xBF);   // -1: no orientation
  EXPECT_EQ(message.at(4 + 24 + 13 * 8 + 7), 0x3F);  // wx: 1
  CameraInfo camera;
  camera.distortion_model = "plumb_bob";
  camera.distortion = {1, 2, 3, 4, 5};
  // 8 + 4 + 4 "cam", height, width, 4 + 10 and padding, 4 and padding: 48.
  EXPECT_EQ(camera_info(1, "cam", camera).size(), 4 + 48 + (5 + 9 + 9 + 12) * 8 + 6 * 4 + 1);
}

TEST(McapRos2, ADefinitionHasEachTypeThatItIsMadeOfOnce) {
  const std::string text = definition_of("tf2_msgs/msg/TFMessage");
  EXPECT_TRUE(text.starts_with("geometry_msgs/TransformStamped[] transforms\n==="));
  for (const char* part : {"TransformStamped", "Transform", "Vector3", "Quaternion"}) {
    const std::string head = std::string("\nMSG: geometry_msgs/") + part + "\n";
    ASSERT_THAT(text, HasSubstr(head));
    EXPECT_EQ(text.find(head), text.rfind(head)) << part;
  }
  EXPECT_THAT(text, HasSubstr("MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"));
  EXPECT_EQ(definition_of("std_msgs/msg/String"), "string data\n");
  EXPECT_EQ(definition_of("my_msgs/msg/Any"), "");
}

}  // namespace
}  // namespace orbbuf::mcap::ros2
