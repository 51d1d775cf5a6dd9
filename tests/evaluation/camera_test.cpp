// SPDX-License-Identifier: Apache-2.0
#include "evaluation/camera.hpp"

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

TEST(CameraFile, OtherModelsAreRefused) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "camera.txt")
      << "FOV 0.5 0.7 0.5 0.5 0.9\n640 480\ncrop\n640 480\n";
  EXPECT_THROW(read_camera(folder.path() / "camera.txt"), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::evaluation
