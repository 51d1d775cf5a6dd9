// SPDX-License-Identifier: Apache-2.0
#include "evaluation/camera.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <stdexcept>

#include "testing/temporary_folder.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr Camera kMono{190, 190, 159.5, 119.5, 320, 240, 0};

Camera stereo() {
  Camera camera = kMono;
  camera.baseline_m = 0.12;
  return camera;
}

TEST(CameraFile, ComesBackAsWritten) {
  const test::TemporaryFolder folder;
  for (const Camera& camera : {kMono, stereo()}) {
    std::ofstream(folder.path() / "camera.txt") << to_text(camera);
    const Camera read = read_camera(folder.path() / "camera.txt");
    EXPECT_EQ(read.cy, 119.5);
    EXPECT_EQ(read.height_px, 240);
    EXPECT_EQ(read.baseline_m, camera.baseline_m);
  }
}

class CameraText : public testing::Test {
 protected:
  std::filesystem::path file(const std::string& text) const {
    std::ofstream(folder_.path() / "camera.txt") << text;
    return folder_.path() / "camera.txt";
  }
  std::string complaint(const std::string& text) const {
    try {
      read_camera(file(text));
      return "";
    } catch (const std::runtime_error& error) {
      return error.what();
    }
  }

  const test::TemporaryFolder folder_;
};

TEST_F(CameraText, WhatDsoMakesOfTheImagesIsNoMatter) {
  for (const std::string third : {"crop", "full", "none", "0.4 0.53 0.5 0.5 0"}) {
    const Camera camera =
        read_camera(file("Pinhole 400 410 320 240 0\n640 480\n" + third + "\n320 240\n"));
    EXPECT_EQ(camera.fy, 410) << third;
    EXPECT_EQ(camera.width_px, 640) << third;
  }
}

TEST_F(CameraText, ALensWithoutDistortionIsAPinhole) {
  for (const std::string lens :
       {"400 400 320 240 0", "400 400 320 240 0 0 0 0", "FOV 400 400 320 240 0",
        "RadTan 400 400 320 240 0 0 0 0", "Pinhole 0.625 0.8333333333 0.50078125 0.5010416667 0"}) {
    EXPECT_NEAR(read_camera(file(lens + "\n640 480\ncrop\n640 480\n")).cx, 320, 1e-6) << lens;
  }
}

TEST_F(CameraText, ALensThatDistortsIsForOtherPrograms) {
  for (const std::string lens : {"FOV 0.5 0.7 0.5 0.5 0.9", "RadTan 400 400 320 240 0 0 0.1 0",
                                 "EquiDistant 400 400 320 240 0 0 0 0"}) {
    const std::string text = lens + "\n640 480\nfull\n640 480\n0.1\n";
    EXPECT_THAT(complaint(text), testing::HasSubstr("distorts")) << lens;
    EXPECT_EQ(read_calibration(file(text)).baseline_m(), 0.1) << lens;
  }
}

TEST_F(CameraText, AnErrorNamesTheLineAndWhatBelongsThere) {
  EXPECT_THAT(complaint("Pinhole 400 400 320 240 0\n640 480\nhalf\n640 480\n"),
              testing::HasSubstr("line 3: expected crop, full, none"));
  EXPECT_THROW(read_calibration(folder_.path() / "none.txt"), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::evaluation
