// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>
#include <string>

#include "server/dataset/layouts.hpp"

namespace orbbuf {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pointwise;

const std::string kSizes = "\n640 480\nnone\n640 480\n";

/// Four frames at 25 a second, then a gap.
RecordedSession session_with(const std::string& calibration, bool is_stereo = false) {
  RecordedSession session;
  for (const int n : {0, 1, 2, 3, 40}) {
    RecordedFrame frame;
    frame.sequence = static_cast<Sequence>(n);
    frame.capture_time_ns = n * 40'000'000LL;
    frame.left_bytes = is_stereo ? 1 : 0;
    session.frames.push_back(frame);
  }
  session.summary.info.calibration = calibration;
  return session;
}

/// What stands behind `key` in the one line that begins with it.
std::string value_of(const std::string& text, const std::string& key) {
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with(key + ": ")) return line.substr(key.size() + 2);
  }
  return "no " + key;
}

std::vector<double> numbers(std::string text) {
  for (char& c : text) c = c == ',' || c == '[' || c == ']' ? ' ' : c;
  std::istringstream in(text);
  std::vector<double> found;
  for (double number = 0; in >> number;) found.push_back(number);
  return found;
}

MATCHER(IsNear, "") { return std::abs(std::get<0>(arg) - std::get<1>(arg)) < 1e-9; }

struct Lens {
  const char* camera_txt;
  const char* model;
  std::vector<double> distortion;
};

class EurocCamera : public testing::TestWithParam<Lens> {};

TEST_P(EurocCamera, SaysEveryLens) {
  Dataset made;
  add_euroc_calibration(session_with(GetParam().camera_txt + kSizes), made);
  EXPECT_THAT(made.notes, IsEmpty());
  ASSERT_EQ(made.texts.size(), 1U);
  EXPECT_EQ(made.texts[0].to, "mav0/cam0/sensor.yaml");
  const std::string& yaml = made.texts[0].content;
  EXPECT_EQ(value_of(yaml, "sensor_type"), "camera");
  EXPECT_EQ(value_of(yaml, "camera_model"), "pinhole");
  EXPECT_EQ(value_of(yaml, "rate_hz"), "25.000");
  EXPECT_THAT(numbers(value_of(yaml, "resolution")), ElementsAre(640, 480));
  EXPECT_THAT(numbers(value_of(yaml, "intrinsics")), ElementsAre(500.25, 501, 320, 240.5));
  EXPECT_EQ(value_of(yaml, "distortion_model"), GetParam().model);
  EXPECT_THAT(numbers(value_of(yaml, "distortion_coefficients")),
              Pointwise(IsNear(), GetParam().distortion));
}

INSTANTIATE_TEST_SUITE_P(
    Each, EurocCamera,
    testing::Values(Lens{"Pinhole 500.25 501 320 240.5 0", "radial-tangential", {0, 0, 0, 0}},
                    Lens{"RadTan 500.25 501 320 240.5 -0.28 0.07 2e-4 1.7e-5",
                         "radial-tangential",
                         {-0.28, 0.07, 2e-4, 1.7e-5}},
                    Lens{"FOV 500.25 501 320 240.5 0.9", "fov", {0.9}},
                    Lens{"EquiDistant 500.25 501 320 240.5 0.1 0.2 0.3 0.4",
                         "equidistant",
                         {0.1, 0.2, 0.3, 0.4}},
                    Lens{"KannalaBrandt 500.25 501 320 240.5 0.1 0.2 0.3 0.4",
                         "equidistant",
                         {0.1, 0.2, 0.3, 0.4}}),
    [](const auto& lens) {
      return std::string(lens.param.camera_txt)
          .substr(0, std::string(lens.param.camera_txt).find(' '));
    });

TEST(EurocCameraTest, OfAPairTheRightOneIsABaselineAway) {
  Dataset made;
  add_euroc_calibration(session_with("Pinhole 500 500 320 240 0" + kSizes + "0.125\n", true), made);
  EXPECT_THAT(made.notes, IsEmpty());
  ASSERT_EQ(made.texts.size(), 2U);
  EXPECT_EQ(made.texts[1].to, "mav0/cam1/sensor.yaml");
  EXPECT_THAT(numbers(value_of(made.texts[0].content, "  data")), ElementsAre(1, 0, 0, 0));
  EXPECT_THAT(numbers(value_of(made.texts[1].content, "  data")), ElementsAre(1, 0, 0, 0.125));
}

TEST(EurocCameraTest, WithoutABaselineTheRightOneIsNotMadeUp) {
  Dataset made;
  add_euroc_calibration(session_with("Pinhole 500 500 320 240 0" + kSizes, true), made);
  EXPECT_EQ(made.texts.size(), 1U);
  EXPECT_THAT(made.notes, ElementsAre(HasSubstr("no cam1/sensor.yaml")));
}

TEST(EurocCameraTest, OfAChainTheBodyIsTheInertialSensor) {
  Dataset made;
  const std::string camera =
      "  camera_model: pinhole\n  intrinsics: [500, 500, 320, 240]\n  resolution: [640, 480]\n";
  add_euroc_calibration(
      session_with("cam0:\n" + camera +
                       "  T_cam_imu: [[0, 1, 0, 0.5], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
                       "cam1:\n" +
                       camera +
                       "  T_cn_cnm1: [[1, 0, 0, -0.25], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
                       "imu0:\n  gyroscope_noise_density: 0.125\n  gyroscope_random_walk: 1e-4\n"
                       "  accelerometer_noise_density: 0.5\n  accelerometer_random_walk: 2e-3\n"
                       "  update_rate: 200\n",
                   true),
      made);
  EXPECT_THAT(made.notes, IsEmpty());
  ASSERT_EQ(made.texts.size(), 3U);
  EXPECT_EQ(made.texts[0].to, "mav0/imu0/sensor.yaml");
  EXPECT_EQ(value_of(made.texts[0].content, "sensor_type"), "imu");
  EXPECT_EQ(value_of(made.texts[0].content, "gyroscope_noise_density"), "0.125");
  EXPECT_THAT(numbers(value_of(made.texts[1].content, "  data")), ElementsAre(0, -1, 0, 0));
  EXPECT_THAT(made.texts[1].content, HasSubstr("1.0, 0.0, 0.0, -0.5,"));
  EXPECT_THAT(made.texts[2].content, HasSubstr("1.0, 0.0, 0.0, -0.25,"))
      << "x of the camera is y of the sensor";
}

TEST(EurocCameraTest, WithoutThePlaceOfTheSensorTheBodyIsTheLeftCameraAndANoteSaysSo) {
  Dataset made;
  add_euroc_calibration(
      session_with("cam0: {camera_model: pinhole, intrinsics: [500, 500, 320, 240], resolution: "
                   "[640, 480]}\n"
                   "imu0: {gyroscope_noise_density: 1, gyroscope_random_walk: 1, "
                   "accelerometer_noise_density: 1, accelerometer_random_walk: 1}\n"),
      made);
  EXPECT_THAT(made.notes, ElementsAre(HasSubstr("neither T_cam_imu nor T_imu_cam")));
}

TEST(EurocCameraTest, OneFrameHasNoRate) {
  RecordedSession session = session_with("Pinhole 500 500 320 240 0" + kSizes);
  session.frames.resize(1);
  Dataset made;
  add_euroc_calibration(session, made);
  EXPECT_EQ(value_of(made.texts.at(0).content, "rate_hz"), "no rate_hz");
}

TEST(KittiCamera, IsAProjectionInPixels) {
  Dataset made;
  add_kitti_camera(session_with("Pinhole 0.5 0.75 0.25 0.5 0" + kSizes + "0.5\n", true), made);
  EXPECT_THAT(made.notes, IsEmpty());
  ASSERT_EQ(made.texts.size(), 1U);
  EXPECT_EQ(made.texts[0].to, "calib.txt");
  const std::string& calib = made.texts[0].content;
  EXPECT_THAT(numbers(value_of(calib, "P0")),
              ElementsAre(320, 0, 159.5, 0, 0, 360, 239.5, 0, 0, 0, 1, 0));
  EXPECT_THAT(numbers(value_of(calib, "P1")),
              ElementsAre(320, 0, 159.5, DoubleNear(-160, 1e-9), 0, 360, 239.5, 0, 0, 0, 1, 0));
}

TEST(KittiCamera, OfOneCameraThereIsOneProjection) {
  Dataset made;
  add_kitti_camera(session_with("Pinhole 500 500 320 240 0" + kSizes + "0.5\n"), made);
  EXPECT_EQ(value_of(made.texts.at(0).content, "P1"), "no P1");
}

TEST(KittiCamera, WithoutABaselineTheRightOneIsNotMadeUp) {
  Dataset made;
  add_kitti_camera(session_with("Pinhole 500 500 320 240 0" + kSizes, true), made);
  EXPECT_EQ(value_of(made.texts.at(0).content, "P1"), "no P1");
  EXPECT_THAT(made.notes, ElementsAre(HasSubstr("no P1 in calib.txt")));
}

TEST(KittiCamera, ALensThatBendsIsLeftOutByName) {
  for (const char* camera : {"RadTan 500 500 320 240 0 0 0 0", "FOV 500 500 320 240 0.9",
                             "EquiDistant 500 500 320 240 0 0 0 0"}) {
    Dataset made;
    add_kitti_camera(session_with(camera + kSizes), made);
    EXPECT_THAT(made.texts, IsEmpty());
    const std::string name = std::string(camera).substr(0, std::string(camera).find(' '));
    EXPECT_THAT(made.notes, ElementsAre("no calib.txt: KITTI's knows no lens distortion, and "
                                        "the camera is " +
                                        name));
  }
}

TEST(CameraFiles, ACalibrationThatCannotBeReadIsANote) {
  Dataset made;
  add_euroc_calibration(session_with("Pinhole 1 2 3\n"), made);
  add_kitti_camera(session_with("Pinhole 1 2 3\n"), made);
  EXPECT_THAT(made.texts, IsEmpty());
  EXPECT_THAT(made.notes, ElementsAre(HasSubstr("camera.txt: 1 lines"), HasSubstr("camera.txt")));
}

}  // namespace
}  // namespace orbbuf
