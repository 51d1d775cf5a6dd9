// SPDX-License-Identifier: Apache-2.0
#include "common/calibration/kalibr.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <string>

#include "common/calibration/camera_info.hpp"

namespace orbbuf {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pointwise;
using testing::SizeIs;

// As Kalibr writes it, of EuRoC's sensors: the cameras are turned by a degree about y.
const std::string kChain =
    "cam0:\n"
    "  T_cam_imu:\n"
    "  - [0.0, 1.0, 0.0, 0.1]\n"
    "  - [-1.0, 0.0, 0.0, 0.2]\n"
    "  - [0.0, 0.0, 1.0, 0.3]\n"
    "  - [0.0, 0.0, 0.0, 1.0]\n"
    "  cam_overlaps: [1]\n"
    "  camera_model: pinhole\n"
    "  distortion_coeffs: [-0.28, 0.07,\n"
    "    0.0002, 1.8e-05]\n"
    "  distortion_model: radtan\n"
    "  intrinsics: [458.5, 457.5, 367.25, 248.5]\n"
    "  resolution: [752, 480]\n"
    "  rostopic: /cam0/image_raw\n"
    "  timeshift_cam_imu: -0.0125\n"
    "cam1:\n"
    "  T_cn_cnm1:\n"
    "  - [0.9998476951563913, 0.0, 0.01745240643728351, -0.11]\n"
    "  - [0.0, 1.0, 0.0, 0.0]\n"
    "  - [-0.01745240643728351, 0.0, 0.9998476951563913, 0.0]\n"
    "  - [0.0, 0.0, 0.0, 1.0]\n"
    "  camera_model: pinhole\n"
    "  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]\n"
    "  distortion_model: equidistant\n"
    "  intrinsics: [457.5, 456.5, 379.25, 255.5]\n"
    "  resolution: [752, 480]\n";
const std::string kImu =
    "imu0:\n"
    "  accelerometer_noise_density: 0.002\n"
    "  accelerometer_random_walk: 0.003\n"
    "  gyroscope_noise_density: 0.00017\n"
    "  gyroscope_random_walk: 1.9e-05\n"
    "  rostopic: /imu0\n"
    "  update_rate: 200.0\n";

TEST(Kalibr, AChainSaysWhereEachSensorIs) {
  const auto parsed = parse_calibration(kChain + kImu);
  ASSERT_TRUE(parsed) << parsed.error().text;
  const Calibration& read = parsed.value();
  EXPECT_EQ(read.left.model, LensModel::kRadTan);
  EXPECT_EQ(read.left.fx_px, 458.5);
  EXPECT_EQ(read.left.height_px, 480);
  EXPECT_THAT(read.left.distortion, ElementsAre(-0.28, 0.07, 0.0002, 1.8e-05));
  EXPECT_EQ(read.right.value().model, LensModel::kEquidistant);
  EXPECT_THAT(read.right_from_left.translation_m, ElementsAre(-0.11, 0, 0));
  EXPECT_THAT(read.left_from_imu.value().translation_m, ElementsAre(0.1, 0.2, 0.3));
  EXPECT_THAT(read.left_from_imu->inverse().translation_m, ElementsAre(0.2, -0.1, -0.3));
  EXPECT_EQ(read.time_shift_s, -0.0125);
  EXPECT_EQ(read.baseline_m(), 0) << "it is not rectified";
  ASSERT_THAT(read.imus, SizeIs(1));
  EXPECT_EQ(read.imus[0].rate_hz, 200);
  EXPECT_EQ(read.imus[0].gyroscope_random_walk, 1.9e-05);
}

std::string with(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(Kalibr, IsADocumentWhateverItsFirstLineAndItsQuotes) {
  const std::string quoted = with(with(kChain, "cam0:", "\"cam0\":"), "cam1:", "'cam1':");
  for (const std::string& text :
       {"%YAML:1.0\n" + kChain, "%YAML:1.0 # for OpenCV\n\n" + kChain, "---\n" + kChain,
        "# by hand\n\n%YAML 1.0\n---\n" + kChain, "\xef\xbb\xbf" + kChain, quoted}) {
    EXPECT_TRUE(is_kalibr(text));
    const auto parsed = parse_calibration(text + kImu);
    ASSERT_TRUE(parsed) << text << parsed.error().text;
    EXPECT_EQ(parsed.value().left.fx_px, 458.5);
    EXPECT_TRUE(parsed.value().right);
    EXPECT_THAT(parsed.value().imus, SizeIs(1));
  }
}

TEST(Kalibr, OpenVinssTImuCamIsTheInverse) {
  const std::string text = with(kChain,
                                "T_cam_imu:\n"
                                "  - [0.0, 1.0, 0.0, 0.1]\n"
                                "  - [-1.0, 0.0, 0.0, 0.2]\n"
                                "  - [0.0, 0.0, 1.0, 0.3]\n",
                                "T_imu_cam:\n"
                                "  - [0.0, -1.0, 0.0, 0.2]\n"
                                "  - [1.0, 0.0, 0.0, -0.1]\n"
                                "  - [0.0, 0.0, 1.0, -0.3]\n");
  const auto left_from_imu = parse_kalibr(text).value().left_from_imu.value();
  EXPECT_THAT(left_from_imu.translation_m, Pointwise(DoubleNear(1e-12), {0.1, 0.2, 0.3}));
  EXPECT_THAT(left_from_imu.rotation, ElementsAre(0, 1, 0, -1, 0, 0, 0, 0, 1));
}

TEST(Kalibr, TwoCamerasByTheSensorAreAPair) {
  const std::string rows = "[[1, 0, 0, -0.25], [0, 1, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]]";
  const std::string chain = with(kChain, "  T_cn_cnm1:\n", "  T_cam_imu: " + rows + "\n  other:\n");
  const auto parsed = parse_kalibr(chain);
  ASSERT_TRUE(parsed) << parsed.error().text;
  // The left camera is at (0.2, -0.1, -0.3) of the sensor.
  EXPECT_THAT(parsed.value().right_from_left.translation_m,
              Pointwise(DoubleNear(1e-12), {-0.05, 0.4, -0.3}));
  const auto inverse = parse_kalibr(
      with(chain, rows, "[[1, 0, 0, -0.25], [0, 1, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]]  # again"));
  EXPECT_EQ(inverse.value().right_from_left.rotation, parsed.value().right_from_left.rotation);
}

TEST(Kalibr, ASecondCameraInTheSamePlaceIsNotUsed) {
  const auto parsed = parse_kalibr(with(kChain, "-0.11]", "0]"));
  ASSERT_TRUE(parsed) << parsed.error().text;
  EXPECT_FALSE(parsed.value().right);
  EXPECT_THAT(parsed.value().remarks, ElementsAre(HasSubstr("in one place")));
  EXPECT_TRUE(parse_kalibr(kChain).value().remarks.empty());
}

TEST(Kalibr, AModelThatNothingHereReadsIsNamedAndTheFileIsKept) {
  for (const auto& [from, to, what] :
       {std::tuple("pinhole\n", "ds\n", "cam0.camera_model: ds; expected pinhole"),
        {"radtan", "rational", "cam0.distortion_model: rational; expected radtan"}}) {
    const std::string text = with(kChain, from, to);
    const auto parsed = parse_any_calibration(text);
    ASSERT_TRUE(parsed) << parsed.error().text;
    EXPECT_THAT(parsed.value().unread, HasSubstr(what));
    EXPECT_EQ(parsed.value().left.width_px, 752);
    EXPECT_FALSE(parse_calibration(text));
    const auto files = calibration_files(text);
    ASSERT_THAT(files, SizeIs(1));
    EXPECT_EQ(files[0].text, text);
  }
}

TEST(Kalibr, TheNoiseOfASensorIsAboveZero) {
  for (const auto& [from, to] : {std::pair("0.002", "0"), {"0.00017", "-1"}, {"1.9e-05", "none"}}) {
    const auto read = parse_kalibr(kChain + with(kImu, from, to));
    ASSERT_FALSE(read) << to;
    EXPECT_THAT(read.error().text, HasSubstr("imu0."));
  }
  EXPECT_THAT(parse_kalibr(kChain + "imu0:\n  update_rate: 200\n").error().text,
              HasSubstr("imu0.gyroscope_noise_density: expected a number above 0"));
}

const std::string kFlatImu =
    "accelerometer_noise_density: 0.01\naccelerometer_random_walk: 0.02\n"
    "gyroscope_noise_density: 0.03\ngyroscope_random_walk: 0.04\n";

TEST(Kalibr, SensorsAreJoinedAsDocuments) {
  for (const std::string& imu :
       {kFlatImu, "%YAML:1.0\n" + kFlatImu, "---\n" + kFlatImu, "%YAML:1.0\n\n" + kImu,
        "---\n" + kImu, with(kImu, "imu0", "\"imu0\""), with(kImu, "imu0", "imu1")}) {
    const auto joined = add_imu("%YAML:1.0\n" + kChain, "imu_b", imu);
    ASSERT_TRUE(joined) << joined.error().text;
    const auto parsed = parse_kalibr(joined.value());
    ASSERT_TRUE(parsed) << parsed.error().text << joined.value();
    ASSERT_THAT(parsed.value().imus, SizeIs(1));
    EXPECT_EQ(parsed.value().imus[0].name, "imu_b");
    EXPECT_GT(parsed.value().imus[0].gyroscope_noise_density, 0);
  }
  const std::string several = kImu + with(with(kImu, "imu0", "imu1"), "200.0", "100.0");
  const auto joined = add_imu(kChain, "imu1", several);
  EXPECT_EQ(parse_kalibr(joined.value()).value().imus.at(0).rate_hz, 100);
  EXPECT_THAT(add_imu(kChain, "imu2", several).error().text, HasSubstr("none of which is imu2"));
  EXPECT_FALSE(add_imu(kChain, "imu0", "imu0: [1\n"));
  EXPECT_FALSE(add_imu(kChain, "imu0", "no keys"));
}

TEST(Kalibr, WhatIsRewrittenOpensInOpenCv) {
  const std::string odd =
      "  odd: \"a: \\\"b\\\"\"\n  none:\n  empty: []\n  deep: {a: [1, {b: 2}]}\n";
  const auto text = add_imu(with(kChain, "cam1:\n", odd + "cam1:\n"), "imu0", kImu);
  ASSERT_TRUE(text) << text.error().text;
  const cv::FileStorage file(text.value(), cv::FileStorage::READ | cv::FileStorage::MEMORY);
  const auto cam0 = file["cam0"];
  for (int row = 0; row < 4; ++row) EXPECT_EQ(cam0["T_cam_imu"][row].size(), 4U);
  EXPECT_EQ(static_cast<double>(cam0["T_cam_imu"][1][3]), 0.2);
  EXPECT_EQ(static_cast<double>(cam0["distortion_coeffs"][3]), 1.8e-05);
  EXPECT_EQ(static_cast<int>(cam0["resolution"][0]), 752);
  EXPECT_EQ(static_cast<std::string>(cam0["rostopic"]), "/cam0/image_raw");
  EXPECT_EQ(static_cast<std::string>(cam0["odd"]), "a: \"b\"");
  EXPECT_EQ(static_cast<double>(file["cam1"]["T_cn_cnm1"][0][2]), 0.01745240643728351);
  EXPECT_EQ(static_cast<double>(file["imu0"]["gyroscope_random_walk"]), 1.9e-05);
  EXPECT_EQ(rewrite_kalibr(text.value()).value(), text.value());
  EXPECT_EQ(parse_kalibr(text.value()).value().right, parse_kalibr(kChain).value().right);
  EXPECT_FALSE(rewrite_kalibr("cam0: &a [*a]\n"));
}

TEST(Kalibr, DsoGetsTheLeftCameraAsItsOwnFile) {
  const auto files = calibration_files(kChain);
  ASSERT_THAT(files, SizeIs(2));
  EXPECT_EQ(files[0].name, "camera.txt");
  EXPECT_EQ(files[0].text,
            "RadTan 458.5 457.5 367.25 248.5 -0.28 0.07 0.0002 1.8e-05\n752 480\ncrop\n752 480\n");
  EXPECT_EQ(files[1].name, "camchain-imucam.yaml");
  EXPECT_EQ(files[1].text, kChain);
}

/// Where a camera with that projection shows a point of the rectified left one: column, row, depth.
Vector3 seen_by(const CameraInfo& camera, const Vector3& p) {
  const auto& m = camera.p;
  const Vector3 image{m[0] * p[0] + m[2] * p[2] + m[3], m[5] * p[1] + m[6] * p[2], p[2]};
  return {image[0] / image[2], image[1] / image[2], p[2]};
}

TEST(Kalibr, APairIsRectified) {
  const auto calibration = parse_kalibr(kChain);
  ASSERT_TRUE(calibration);
  const auto cameras = calibrated_cameras(kChain);
  ASSERT_TRUE(cameras.left && cameras.right) << cameras.problem;
  EXPECT_EQ(cameras.left->k[0], 458.5);
  EXPECT_EQ(cameras.right->distortion_model, "equidistant");
  for (const Vector3& point : {Vector3{0.5, -0.25, 4}, Vector3{-1, 0.75, 2}}) {
    const Vector3 in_right =
        (calibration.value().right_from_left * Pose{kIdentity, point}).translation_m;
    Vector3 rectified = cameras.right->r * in_right;
    rectified[0] += 0.11;  // where the right one is
    EXPECT_THAT(cameras.left->r * point, Pointwise(DoubleNear(1e-9), rectified));
    const Vector3 left = seen_by(*cameras.left, rectified);
    const Vector3 right = seen_by(*cameras.right, rectified);
    EXPECT_NEAR(left[1], right[1], 1e-9) << "the rows are the same";
    EXPECT_NEAR(left[0] - right[0], cameras.left->p[0] * 0.11 / left[2], 1e-9)
        << "the columns tell the depth";
  }
}

struct Damage {
  const char* from;
  const char* to;
  const char* why;
};

class BadChain : public testing::TestWithParam<Damage> {};

TEST_P(BadChain, IsRefusedWithItsKey) {
  std::string text = kChain;
  const auto at = text.find(GetParam().from);
  ASSERT_NE(at, std::string::npos);
  text.replace(at, std::string(GetParam().from).size(), GetParam().to);
  const auto read = parse_calibration(text);
  ASSERT_FALSE(read);
  EXPECT_THAT(read.error().text, HasSubstr("camchain-imucam.yaml: "));
  EXPECT_THAT(read.error().text, HasSubstr(GetParam().why));
}

INSTANTIATE_TEST_SUITE_P(
    Each, BadChain,
    testing::Values(Damage{"pinhole", "omni", "cam0.camera_model"},
                    Damage{"radtan", "rat", "cam0.distortion_model"},
                    Damage{"[458.5, ", "[", "cam0.intrinsics: expected 4 numbers"},
                    Damage{"[458.5, ", "[.nan, ", "cam0.intrinsics"},
                    Damage{"[458.5, ", "[0, ", "cam0.intrinsics"},
                    Damage{"[752, ", "[1e9, ", "cam0.resolution"},
                    Damage{"[0.0, 1.0, 0.0, 0.1]", "[2.0, 1.0, 0.0, 0.1]",
                           "cam0.T_cam_imu: not a rotation"},
                    Damage{"  - [0.0, 1.0, 0.0, 0.1]\n", "", "cam0.T_cam_imu: expected four rows"},
                    Damage{"T_cn_cnm1", "T_else", "cam1.T_cn_cnm1: missing"},
                    Damage{"-0.0125", "soon", "cam0.timeshift_cam_imu: expected a number"},
                    Damage{"cam_overlaps: [1]", "cam_overlaps: [1", ""}));

TEST(Kalibr, WhatIsNoMapIsRefused) {
  EXPECT_FALSE(parse_kalibr("cam0:"));
  EXPECT_FALSE(parse_kalibr("cam0: [1, 2]"));
  EXPECT_FALSE(parse_kalibr("- cam0:\n"));
  EXPECT_FALSE(parse_kalibr("cam0: " + std::string(16'000, '[')));
  EXPECT_FALSE(parse_kalibr("cam0: &a [*a]\n"));
}

}  // namespace
}  // namespace orbbuf
