// SPDX-License-Identifier: Apache-2.0
// The bytes are written out by hand from protobuf's encoding; tests/e2e/mcap.sh has an independent
// library decode whole recordings by the schemas.
#include "server/foxglove/messages.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "common/as_bytes.hpp"

namespace orbbuf::foxglove {
namespace {

using namespace std::string_literals;

std::string text(const std::vector<std::uint8_t>& bytes) { return {bytes.begin(), bytes.end()}; }

std::string image_at(std::int64_t time_ns) {
  return text(compressed_image(time_ns, "r1", as_bytes("JPEG")));
}

TEST(Foxglove, AnImageIsTimeDataFormatAndFrame) {
  EXPECT_EQ(image_at(1'633'012'345),
            "\x0A\x08\x08\x01\x10\xF9\x80\xEC\xAD\x02"  // 1 s, 633012345 ns
            "\x12\x04JPEG"
            "\x1A\x04jpeg"
            "\x22\x02r1"s);
}

TEST(Foxglove, NanosecondsCountForwardsBeforeTheEpoch) {
  EXPECT_EQ(image_at(-1).substr(0, 19),
            "\x0A\x11\x08\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\x01"  // -1 s, 999999999 ns
            "\x10\xFF\x93\xEB\xDC\x03"s);
}

TEST(Foxglove, ASchemaComesWithTheTimestampItImports) {
  const std::string schema = text(compressed_image_schema().descriptors);
  EXPECT_EQ(compressed_image_schema().name, "foxglove.CompressedImage");
  EXPECT_LT(schema.find("google/protobuf/timestamp.proto"),
            schema.find("foxglove/CompressedImage.proto"));
  EXPECT_NE(schema.find("\x0A\x08"     // a field's name
                        "frame_id"     //
                        "\x18\x04"     // its number
                        "\x20\x01"     // optional
                        "\x28\x09"s),  // a string
            std::string::npos);
}

/// The doubles of a packed field, which is asked for by its tag and length.
std::vector<double> doubles(const std::string& message, const std::string& tag) {
  const std::size_t at = message.find(tag);
  if (at == std::string::npos) return {};
  std::vector<double> values(static_cast<std::size_t>(tag[1]) / sizeof(double));
  std::memcpy(values.data(), message.data() + at + tag.size(), values.size() * sizeof(double));
  return values;
}

TEST(Foxglove, ACalibrationIsTheMatricesUnderFoxglovesNameOfTheModel) {
  CameraInfo camera{160, 120, "plumb_bob", {1, 2, 3, 4, 5}};
  camera.k = {100, 0, 80, 0, 101, 60, 0, 0, 1};
  camera.p = {100, 0, 80, -50, 0, 101, 60, 0, 0, 0, 1, 0};
  std::string message = text(camera_calibration(0, "r1", camera));
  EXPECT_NE(message.find("\x15\xA0\0\0\0\x1D\x78\0\0\0"s), std::string::npos);  // 160x120
  EXPECT_NE(message.find("\x22\x09plumb_bob"), std::string::npos);
  EXPECT_EQ(doubles(message, "\x2A\x28"), camera.distortion);
  EXPECT_EQ(doubles(message, "\x32\x48"), (std::vector<double>{100, 0, 80, 0, 101, 60, 0, 0, 1}));
  EXPECT_EQ(doubles(message, "\x42\x60"),
            (std::vector<double>{100, 0, 80, -50, 0, 101, 60, 0, 0, 0, 1, 0}));

  camera.distortion_model = "equidistant";
  message = text(camera_calibration(0, "r1", camera));
  EXPECT_NE(message.find("\x22\x0Ekannala_brandt"), std::string::npos);
}

}  // namespace
}  // namespace orbbuf::foxglove
