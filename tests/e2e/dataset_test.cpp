// SPDX-License-Identifier: Apache-2.0
// What the server recorded of a real robot, checked and exported by the real program.
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>

#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

class DatasetTest : public testing::Test {
 protected:
  static constexpr int kFrames = 10;

  void SetUp() override {
    Server server(out_);
    run_robot(server);
    session_ = read_record(out_, "r").folder;
  }

  static void run_robot(const Server& server) {
    Process robot(robot_command("r", server.address(),
                                {"source.width=160", "source.height=120", "source.realtime=false",
                                 "source.frames=" + std::to_string(kFrames)}));
    ASSERT_EQ(robot.wait(), 0) << robot.output();
  }

  TemporaryFolder folder_;
  const fs::path out_ = folder_ / "frames";
  fs::path session_;
};

TEST_F(DatasetTest, WhatWasRecordedIsSoundUntilAByteFlips) {
  const Finished sound = run({kOrbbufServer, "check", session_});
  EXPECT_EQ(sound.status, 0) << sound.output;
  EXPECT_NE(sound.output.find(session_.string() + ": OK: "), std::string::npos) << sound.output;

  const fs::path image = fs::directory_iterator(session_ / "images")->path();
  std::string bytes = read_file(image);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  write_file(image, bytes);
  const Finished damaged = run({kOrbbufServer, "check", "/nowhere", session_});
  EXPECT_EQ(damaged.status, 1);
  EXPECT_NE(damaged.output.find("/nowhere: not a session"), std::string::npos) << damaged.output;
  EXPECT_NE(damaged.output.find(session_.string() + ": images/" + image.filename().string() +
                                ": not as it was received"),
            std::string::npos)
      << damaged.output;
}

TEST(LiveDataset, OfASessionThatGoesOnCheckSaysThatItIsOpen) {
  const TemporaryFolder folder;
  const std::string runtime = "XDG_RUNTIME_DIR=" + folder.path().string();
  Server server(folder / "frames", {}, "127.0.0.1:0", {"env", runtime});
  Process robot(robot_command("r", server.address(), {"source.frames=1000000"}));
  ASSERT_TRUE(robot.wait_for_lines("] captured ", 2)) << robot.output();
  const std::string session = read_record(folder / "frames", "r").folder;
  const Finished open = run({"env", runtime, kOrbbufServer, "check", session});
  EXPECT_EQ(open.status, 0) << open.output;
  EXPECT_NE(open.output.find(session + ": open: "), std::string::npos) << open.output;
  server.process().signal(SIGKILL);
  server.process().wait();
  const Finished dead = run({"env", runtime, kOrbbufServer, "check", session});
  EXPECT_EQ(dead.status, 1) << dead.output;
  EXPECT_NE(dead.output.find(": not ended: "), std::string::npos) << dead.output;
  EXPECT_EQ(dead.output.find("not of any frame"), std::string::npos) << dead.output;
}

TEST_F(DatasetTest, IsExportedOnce) {
  const fs::path made = folder_ / "made";
  const std::vector<std::string> command = {kOrbbufServer, "export", "--layout",
                                            "euroc",       session_, made};
  const Finished first = run(command);
  EXPECT_EQ(first.status, 0) << first.output;
  EXPECT_NE(first.output.find("no calibration"), std::string::npos) << first.output;
  EXPECT_EQ(read_lines(made / "mav0/cam0/data.csv").size(),
            read_lines(session_ / "times.txt").size() + 1);
  const Finished again = run(command);
  EXPECT_EQ(again.status, 1);
  EXPECT_NE(again.output.find(made.string() + ": not empty"), std::string::npos) << again.output;
}

TEST_F(DatasetTest, AnExportComesBackAsASourceWithItsTimes) {
  const auto times = read_lines(session_ / "times.txt");
  const auto replayed = [&](const fs::path& source) {
    const TemporaryFolder out;
    Server server(out.path());
    Process robot(robot_command(
        "r", server.address(),
        {"source.kind=folder", "source.path=" + source.string(), "source.realtime=false"}));
    EXPECT_EQ(robot.wait(), 0) << robot.output();
    return read_lines(read_record(out.path(), "r").folder / "times.txt");
  };
  ASSERT_EQ(times.size(), static_cast<std::size_t>(kFrames));
  for (const char* layout : {"euroc", "tum-rgbd", "kitti", "tum-mono"}) {
    const fs::path made = folder_ / layout;
    EXPECT_EQ(run({kOrbbufServer, "export", "--layout", layout, session_, made}).status, 0);
    EXPECT_EQ(replayed(made), times) << layout;
  }
}

TEST_F(DatasetTest, ACalibrationOfAnotherSizeIsAWarningAtBothEnds) {
  const TemporaryFolder out;
  const fs::path chain = folder_ / "chain.yaml";
  write_file(chain, "%YAML:1.0\n\"cam0\": {camera_model: ds, resolution: [752, 480]}\n");
  const std::vector<std::string> settings = {"source.width=160", "source.height=120",
                                             "source.realtime=false", "source.frames=3",
                                             "camera.calibration=" + chain.string()};
  Server server(out.path());
  Process robot(robot_command("r", server.address(), settings));
  EXPECT_EQ(robot.wait(), 0);
  const std::string warning =
      "the calibration is of images of 752x480 pixels, and the frames have 160x120";
  EXPECT_NE(robot.output().find("camera.calibration: cam0.camera_model: ds"), std::string::npos);
  EXPECT_NE(robot.output().find("camera.calibration: " + warning), std::string::npos);
  const fs::path session = read_record(out.path(), "r").folder;
  EXPECT_TRUE(server.process().wait_for_line(session.string() + ": " + warning));
  EXPECT_EQ(read_file(session / "camchain-imucam.yaml"),
            "%YAML 1.0\n---\ncam0:\n  camera_model: ds\n  resolution: [752, 480]\n");
  EXPECT_EQ(run({kOrbbufServer, "check", session}).status, 0);
}

TEST_F(DatasetTest, OverTheQuotaTheOlderSessionGoesWhenTheServerIsStartedAgain) {
  {
    Server server(out_, {"files.keep_size=1 GiB"});
    run_robot(server);
    EXPECT_TRUE(fs::exists(session_));
  }
  Server server(out_, {"files.keep_size=1 B"});
  EXPECT_TRUE(server.process().wait_for_line(session_.filename().string() + ": removed, "));
  const auto is_kept = [](const auto& entry) {
    return !entry.path().filename().string().starts_with('.');
  };
  EXPECT_FALSE(fs::exists(session_));
  EXPECT_EQ(std::ranges::count_if(fs::directory_iterator(out_ / "r"), is_kept), 1);
}

TEST(DatasetCommands, RefuseWhatTheyDoNotKnow) {
  const Finished layout = run({kOrbbufServer, "export", "--layout", "tum", "a", "b"});
  EXPECT_NE(layout.status, 0);
  EXPECT_NE(layout.output.find("tum-rgbd"), std::string::npos) << layout.output;
  EXPECT_NE(run({kOrbbufServer, "check"}).status, 0);
  EXPECT_NE(run({kOrbbufServer, "import"}).status, 0);
}

}  // namespace
}  // namespace orbbuf::test
