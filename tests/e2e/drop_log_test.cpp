// SPDX-License-Identifier: Apache-2.0
// What a robot that died leaves for its next start.
#include <gtest/gtest.h>

#include <csignal>

#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

std::string session_of(Process& robot) {
  const std::string line = robot.wait_for_line(", session ").value_or(", session none,");
  const std::size_t begin = line.find(", session ") + std::string(", session ").size();
  return line.substr(begin, line.find(',', begin) - begin);
}

TEST(DropLog, NextStartTellsOfTheFramesThatDiedWithTheRobot) {
  const TemporaryFolder folder;
  const fs::path drops = folder / "drops";
  // Nothing listens there: the frames wait.
  const auto command =
      robot_command("r", "127.0.0.1:1",
                    {"source.frames=1000000", "source.width=64", "source.height=64",
                     "buffer.policy=drop-oldest", "buffer.capacity=3"},
                    {"env", "STATE_DIRECTORY=" + folder.path().string()});
  Process dead(command);
  const std::string session = session_of(dead);
  ASSERT_TRUE(dead.wait_for_lines("] captured ", 2)) << dead.output();
  dead.signal(SIGKILL);
  dead.wait();
  const fs::path file = drops / (session + ".csv");
  const auto left = read_lines(file);
  ASSERT_GT(left.size(), 3U) << dead.output();
  EXPECT_EQ(left.front(), "sequence,reason,capture_time_s");
  EXPECT_TRUE(left.at(1).starts_with("0,policy,")) << left.at(1);

  Process next(command);
  const auto told = next.wait_for_line("session " + session + " did not end in order");
  ASSERT_TRUE(told) << next.output();
  // At least one frame of the three in the buffer.
  EXPECT_EQ(told->find(" 0 frames were"), std::string::npos) << *told;
  EXPECT_NE(told->find(" frames were captured and not confirmed: " + file.string()),
            std::string::npos)
      << *told;
  EXPECT_NE(told->find(" warn "), std::string::npos) << *told;
  EXPECT_EQ(read_lines(file), left);
  EXPECT_TRUE(fs::exists(drops / (session_of(next) + ".csv")));
}

}  // namespace
}  // namespace orbbuf::test
