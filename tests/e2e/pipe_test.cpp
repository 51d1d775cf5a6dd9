// SPDX-License-Identifier: Apache-2.0
// A program in C reads a real server's pipe with the header of the package orbbuf-dev.
#include <gtest/gtest.h>

#include <csignal>
#include <sstream>

#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

/// What the reader of a session of 20 frames has printed.
std::vector<std::string> read_by_c(const std::string& format, const std::filesystem::path& out) {
  Server server(out, {std::string("pipe.command=" ORBBUF_PIPE_READER " ") + format,
                      "pipe.format=" + format, "files.enabled=true"});
  const Finished robot =
      run(robot_command("r", server.address(),
                        {"source.frames=20", "source.realtime=false", "source.width=160",
                         "source.height=120", "buffer.capacity=100"}));
  EXPECT_EQ(robot.status, 0) << robot.output;
  server.process().signal(SIGTERM);
  EXPECT_TRUE(server.process().wait_for_line("end of pipe: whole")) << server.process().output();
  std::vector<std::string> images;
  std::istringstream lines(server.process().output());
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("image ")) images.push_back(line);
  }
  return images;
}

TEST(Pipe, ACProgramReadsEveryImageWithItsNumberAndTime) {
  const TemporaryFolder out;
  const auto images = read_by_c("pgm", out.path());
  const Record record = read_record(out.path(), "r");
  ASSERT_EQ(images.size(), record.delivered.size());
  ASSERT_EQ(images.size(), 20U);
  for (std::size_t i = 0; i < images.size(); ++i) {
    EXPECT_EQ(images[i], "image " + std::to_string(record.delivered[i]) + " " + record.times[i] +
                             " 160x120 camera 0");
  }
}

TEST(Pipe, ACProgramReadsEveryJpegWhole) {
  const TemporaryFolder out;
  const auto images = read_by_c("mjpeg", out.path());
  ASSERT_EQ(images.size(), 20U);
  const auto folder = read_record(out.path(), "r").folder / "images";
  for (std::size_t i = 0; i < images.size(); ++i) {
    const auto file =
        folder / (std::string(i < 10 ? "00000" : "0000") + std::to_string(i) + ".jpg");
    EXPECT_EQ(images[i], "image of " + std::to_string(read_file(file).size()) + " bytes");
  }
}

}  // namespace
}  // namespace orbbuf::test
