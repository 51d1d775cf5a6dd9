// SPDX-License-Identifier: Apache-2.0
// The example of the package orbbuf-dev reads a real server's pipe as its SLAM program.
#include <gtest/gtest.h>

#include <csignal>
#include <sstream>

#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

constexpr std::uint64_t kFrames = 20;

/// What the reader of a session of 20 frames has printed, as the server's log has it.
std::vector<std::string> read_by_c(const std::string& format, const std::filesystem::path& out,
                                   Overrides robot_overrides = {}) {
  Server server(out, {std::string("slam.command=") + kOrbbufFollow, "slam.format=" + format});
  robot_overrides.insert(robot_overrides.end(),
                         {"source.frames=" + std::to_string(kFrames), "source.realtime=false",
                          "source.width=160", "source.height=120", "buffer.capacity=100"});
  const Finished robot = run(robot_command("r", server.address(), robot_overrides));
  EXPECT_EQ(robot.status, 0) << robot.output;
  // A server that stops waits for a second only.
  EXPECT_TRUE(server.process().wait_for_line("exited with status 0"));
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().wait(), 0);
  std::vector<std::string> images;
  std::istringstream lines(server.process().output());
  const std::string mark = "slam: ";
  for (std::string line; std::getline(lines, line);) {
    const std::size_t at = line.find(mark);
    if (at != std::string::npos) images.push_back(line.substr(at + mark.size()));
  }
  EXPECT_EQ(server.process().count_lines("exited with status 0"), 1);
  return images;
}

/// What it prints of a frame's image up to its size.
std::string printed(const Record& record, std::size_t frame, int camera) {
  const std::string& time = record.times[frame];
  return record.folder.filename().string() + " " + std::to_string(record.delivered[frame]) + " " +
         time.substr(0, time.size() - 3) + " camera " + std::to_string(camera) + ": ";
}

/// The size of a kept image with the comment that the pipe adds.
std::string jpeg_size(const Record& record, std::size_t frame, const std::string& camera) {
  char name[32];
  std::snprintf(name, sizeof name, "%06zu.jpg", frame);
  const auto folder = record.folder / (camera == "right" ? "images_right" : "images");
  const std::string lines = "seq=" + std::to_string(frame) + "\nt=" + record.times[frame] +
                            (camera.empty() ? "" : "\ncamera=" + camera) +
                            "\nsession=" + record.folder.filename().string() + "\nquality=80\n";
  return std::to_string(read_file(folder / name).size() + 4 + lines.size()) + " bytes, quality 80";
}

TEST(Pipe, AServerStartedWithSigchldIgnoredKnowsHowItsCommandEnded) {
  const TemporaryFolder out;
  Server server(out.path(), {"slam.command=cat > /dev/null; exit 3"}, "127.0.0.1:0",
                {"sh", "-c", "trap '' CHLD; exec \"$@\"", "sh"});
  const Finished robot =
      run(robot_command("r", server.address(), {"source.frames=3", "source.realtime=false"}));
  EXPECT_EQ(robot.status, 0) << robot.output;
  EXPECT_TRUE(server.process().wait_for_line("exited with status 3")) << server.process().output();
}

TEST(Pipe, ACProgramReadsEveryPgmWithItsNumberAndTime) {
  const TemporaryFolder out;
  const auto images = read_by_c("pgm", out.path());
  const Record record = read_record(out.path(), "r");
  ASSERT_EQ(record.delivered.size(), kFrames);
  ASSERT_EQ(images.size(), kFrames);
  for (std::size_t i = 0; i < images.size(); ++i) {
    EXPECT_EQ(images[i], printed(record, i, 0) + "19200 bytes, quality 80");
  }
}

TEST(Pipe, ACProgramReadsEveryJpegWithItsNumberAndTime) {
  const TemporaryFolder out;
  const auto images = read_by_c("mjpeg", out.path());
  const Record record = read_record(out.path(), "r");
  ASSERT_EQ(record.delivered.size(), kFrames);
  ASSERT_EQ(images.size(), kFrames);
  for (std::size_t i = 0; i < images.size(); ++i) {
    EXPECT_EQ(images[i], printed(record, i, 0) + jpeg_size(record, i, ""));
  }
}

TEST(Pipe, ACProgramReadsTheJpegsOfAStereoStreamLeftAndRight) {
  const TemporaryFolder out;
  const auto images = read_by_c("mjpeg", out.path(), {"source.stereo=side-by-side"});
  const Record record = read_record(out.path(), "r");
  ASSERT_EQ(record.images_right, kFrames);
  ASSERT_EQ(images.size(), 2 * kFrames);
  for (std::size_t i = 0; i < kFrames; ++i) {
    EXPECT_EQ(images[2 * i], printed(record, i, 1) + jpeg_size(record, i, "left"));
    EXPECT_EQ(images[2 * i + 1], printed(record, i, 2) + jpeg_size(record, i, "right"));
  }
}

}  // namespace
}  // namespace orbbuf::test
