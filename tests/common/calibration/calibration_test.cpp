// SPDX-License-Identifier: Apache-2.0
#include "common/calibration/calibration.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace orbbuf {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string kRest = "\n640 480\ncrop\n640 480\n";

Calibration calibration_of(const std::string& text) {
  auto parsed = parse_calibration(text);
  EXPECT_TRUE(parsed) << text << (parsed ? "" : parsed.error().text);
  return parsed ? std::move(parsed).value() : Calibration{};
}

Camera parsed(const std::string& text) { return calibration_of(text).left; }

TEST(Calibration, EveryModelOfDsoIsRead) {
  EXPECT_EQ(parsed("Pinhole 500 501 320 240 0" + kRest).model, LensModel::kPinhole);
  EXPECT_EQ(parsed("RadTan 500 501 320 240 1 2 3 4" + kRest).model, LensModel::kRadTan);
  EXPECT_EQ(parsed("FOV 500 501 320 240 0.9" + kRest).model, LensModel::kFov);
  EXPECT_EQ(parsed("EquiDistant 500 501 320 240 1 2 3 4" + kRest).model, LensModel::kEquidistant);
  const auto camera = parsed("KannalaBrandt 500 501 320 240 1 2 3 -4e-2" + kRest);
  EXPECT_EQ(camera.model, LensModel::kEquidistant);
  EXPECT_EQ(camera.name, "KannalaBrandt");
  EXPECT_EQ(camera.fx_px, 500);
  EXPECT_EQ(camera.fy_px, 501);
  EXPECT_EQ(camera.cx_px, 320);
  EXPECT_EQ(camera.cy_px, 240);
  EXPECT_THAT(camera.distortion, ElementsAre(1, 2, 3, -0.04));
  EXPECT_EQ(camera.width_px, 640);
  EXPECT_EQ(camera.height_px, 480);
}

TEST(Calibration, WithoutANameTheNumbersTell) {
  EXPECT_EQ(parsed("500 501 320 240 1 2 3 4" + kRest).name, "RadTan");
  EXPECT_EQ(parsed("500 501 320 240 0.9" + kRest).name, "FOV");
  const auto pinhole = parsed("500 501 320 240 0" + kRest);
  EXPECT_EQ(pinhole.name, "Pinhole");
  EXPECT_THAT(pinhole.distortion, IsEmpty());
}

TEST(Calibration, RelativeNumbersBecomePixels) {
  const auto camera = parsed("FOV 0.5 0.75 0.25 0.5 0.9" + kRest);
  EXPECT_EQ(camera.fx_px, 320);
  EXPECT_EQ(camera.fy_px, 360);
  EXPECT_EQ(camera.cx_px, 159.5);
  EXPECT_EQ(camera.cy_px, 239.5);
}

TEST(Calibration, AFifthLineIsTheBaseline) {
  const std::string text = "Pinhole 500 501 320 240 0" + kRest;
  EXPECT_EQ(calibration_of(text).baseline_m(), 0);
  const auto pair = calibration_of(text + "0.12\n");
  EXPECT_EQ(pair.baseline_m(), 0.12);
  EXPECT_EQ(pair.right, pair.left);
  EXPECT_EQ(to_camera_txt(pair), text + "0.12\n");
}

TEST(Calibration, BlanksAndLineEndsOfOtherSystemsAreNoMatter) {
  EXPECT_EQ(parsed(" FOV  1 1\t9 9 0.9 \r\n640 480\r\n0.5 0.5 0.5 0.5 0\r\n320 240").width_px, 640);
}

TEST(Calibration, AnotherSizeThanTheFramesIsAProblem) {
  const std::string camera_txt = "Pinhole 500 501 320 240 0" + kRest;
  const std::string chain =
      "cam0: {camera_model: ds, resolution: [640, 480], intrinsics: [1, 2, 3, 4, 5, 6]}\n";
  for (const auto& text : {camera_txt, chain}) {
    EXPECT_EQ(size_problem(text, 640, 480), "");
    EXPECT_EQ(size_problem(text, 640, 360),
              "the calibration is of images of 640x480 pixels, and the frames have 640x360");
  }
  EXPECT_EQ(size_problem("", 640, 480), "");
}

struct Bad {
  const char* text;
  const char* why;
};

class BadCalibration : public testing::TestWithParam<Bad> {};

TEST_P(BadCalibration, IsRefusedWithItsLine) {
  const auto camera = parse_calibration(GetParam().text);
  ASSERT_FALSE(camera);
  EXPECT_THAT(camera.error().text, HasSubstr(GetParam().why));
}

INSTANTIATE_TEST_SUITE_P(
    Each, BadCalibration,
    testing::Values(Bad{"", "0 lines"}, Bad{"Pinhole 1 1 9 9 0\n640 480\ncrop\n", "3 lines"},
                    Bad{"\n640 480\ncrop\n640 480\n", "line 1"},
                    Bad{"Pinhole 1 1 9 9\n640 480\ncrop\n640 480\n", "line 1"},
                    Bad{"Fisheye 1 1 9 9 0\n640 480\ncrop\n640 480\n", "line 1"},
                    Bad{"FOV 1 1 9 nan 0.9\n640 480\ncrop\n640 480\n", "line 1"},
                    Bad{"FOV 0 1 9 9 0.9\n640 480\ncrop\n640 480\n", "line 1"},
                    Bad{"RadTan 1 1 9 9 0\n640 480\ncrop\n640 480\n", "line 1"},
                    Bad{"FOV 1 1 9 9 0.9\n640\ncrop\n640 480\n", "line 2"},
                    Bad{"FOV 1 1 9 9 0.9\n640 0\ncrop\n640 480\n", "line 2"},
                    Bad{"FOV 1 1 9 9 0.9\n640 480\ncropped\n640 480\n", "line 3"},
                    Bad{"FOV 1 1 9 9 0.9\n640 480\n1 2 3 4\n640 480\n", "line 3"},
                    Bad{"FOV 1 1 9 9 0.9\n640 480\nnone\n640 480 3\n", "line 4"},
                    Bad{"FOV 1 1 9 9 0.9\n640 480\nnone\n640 480\n-1\n", "line 5"}));

}  // namespace
}  // namespace orbbuf
