// SPDX-License-Identifier: Apache-2.0
// A robot dies while frames wait for a server; its next start says which they are.
#include <gtest/gtest.h>

#include <csignal>

#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

TEST(DeadRobot, FramesThatTheServerDidNotConfirmAreNamedAtTheNextStart) {
  const TemporaryFolder folder;
  Server server(folder / "out");
  const Overrides settings = {"source.width=320", "source.height=240", "source.frames=1000000",
                              "buffer.drop_log=" + (folder / "drops").string()};
  Process dead(robot_command(kRobot, server.address(), settings));
  ASSERT_TRUE(dead.wait_for_line("connected to")) << dead.output();
  const std::string account = "] captured ";
  ASSERT_TRUE(dead.wait_for_lines(account, 2));
  server.process().signal(SIGKILL);
  ASSERT_TRUE(dead.wait_for_line(", no connection")) << dead.output();
  ASSERT_TRUE(dead.wait_for_lines(account, dead.count_lines(account) + 2));
  dead.signal(SIGKILL);
  dead.wait();

  const Record record = read_record(folder / "out", kRobot);
  const std::string session = record.folder.filename().string();
  Process next(robot_command(kRobot, server.address(), settings));
  const auto line = next.wait_for_line("session " + session + " ended with frames ");
  ASSERT_TRUE(line) << next.output();
  const std::string first = line->substr(line->find("frames ") + 7);
  EXPECT_LE(std::stoull(first), record.delivered.back() + 1) << *line;
  EXPECT_GT(std::stoull(first.substr(first.find("to ") + 3)), record.delivered.back() + 20)
      << *line;
  EXPECT_NE(line->find((folder / "drops" / (session + ".csv")).string()), std::string::npos);
}

}  // namespace
}  // namespace orbbuf::test
