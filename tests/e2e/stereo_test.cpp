// SPDX-License-Identifier: Apache-2.0
// Pairs of images over loopback, with the two real programs.
#include <gtest/gtest.h>

#include <csignal>

#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

/// All files of one folder are those of the other, byte for byte.
void expect_same_files(const fs::path& a, const fs::path& b) {
  const auto diff = run({"diff", "-rq", a.string(), b.string()});
  EXPECT_EQ(diff.status, 0) << diff.output;
}

class Stereo : public testing::Test {
 protected:
  /// What the server keeps of a robot that is run to its end.
  Record keep(const std::string& robot, const Overrides& overrides) {
    const auto result = run(robot_command(robot, server_.address(), overrides));
    EXPECT_EQ(result.status, 0) << result.output;
    return read_record(out_.path(), robot);
  }

  TemporaryFolder out_;
  Server server_{out_.path()};
};

TEST_F(Stereo, JpegPairsFromTwoFoldersArriveByteForByte) {
  Overrides scene = {"source.frames=30", "source.realtime=false", "source.width=160",
                     "source.height=120", "source.seed=1"};
  const fs::path left = keep("left", scene).folder / "images";
  scene.back() = "source.seed=2";
  const fs::path right = keep("right", scene).folder / "images";

  Overrides pairs = replay(left);
  pairs.push_back("source.path_right=" + right.string());
  const Record record = keep("stereo", pairs);
  expect_exactly_once(record, 30);
  EXPECT_EQ(record.delivered.size(), 30U);
  EXPECT_EQ(record.images_right, 30U);
  expect_same_files(record.folder / "images", left);
  expect_same_files(record.folder / "images_right", right);
}

TEST_F(Stereo, ARealSequenceArrivesAsItsTwoSidesDoAlone) {
  const fs::path sequence = shared_sequence("kitti05_stereo");
  if (sequence.empty()) GTEST_SKIP() << "no ../shared/data/sequences/kitti05_stereo";
  Overrides pairs = replay(sequence / "images");
  pairs.push_back("source.path_right=" + (sequence / "images_right").string());
  const Record record = keep("stereo", pairs);
  expect_exactly_once(record, 60);
  EXPECT_EQ(record.images_right, 60U);
  const Record left = keep("left", replay(sequence / "images"));
  EXPECT_EQ(left.images_right, 0U);
  EXPECT_EQ(record.times, left.times);
  expect_same_files(record.folder / "images", left.folder / "images");
  const Record right = keep("right", replay(sequence / "images_right"));
  expect_same_files(record.folder / "images_right", right.folder / "images");
}

TEST_F(Stereo, FoldersOfDifferentLengthStopTheStart) {
  const Overrides scene = {"source.frames=3", "source.realtime=false"};
  const fs::path left = keep("left", scene).folder / "images";
  fs::create_directory(out_ / "right");
  fs::copy(left / "000000.jpg", out_ / "right");
  Overrides pairs = replay(left);
  pairs.push_back("source.path_right=" + (out_ / "right").string());
  const auto result = run(robot_command("stereo", server_.address(), pairs));
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.output.find("1 right images, 3 left images"), std::string::npos)
      << result.output;
}

}  // namespace
}  // namespace orbbuf::test
