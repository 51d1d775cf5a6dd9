// SPDX-License-Identifier: Apache-2.0
// A robot dies while frames wait for a server; its next start says which they are.
#include <gtest/gtest.h>

#include <csignal>

#include "tests/e2e/programs.hpp"
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
  const auto line = next.wait_for_line(session + " ended with frames ");
  ASSERT_TRUE(line) << next.output();
  const std::string first = line->substr(line->find("frames ") + 7);
  EXPECT_LE(std::stoull(first), record.delivered.back() + 1) << *line;
  EXPECT_GT(std::stoull(first.substr(first.find("to ") + 3)), record.delivered.back() + 20)
      << *line;

  const Server again(folder / "out", {}, server.address());
  ASSERT_TRUE(next.wait_for_line("the server knows what became of session " + session));
  const Finished check = run({kOrbbufServer, "check", record.folder});
  EXPECT_NE(check.output.find("not ended"), std::string::npos) << check.output;
  const std::string drops = read_file(record.folder / "drops.csv");
  const std::string last = first.substr(first.find("to ") + 3);
  EXPECT_NE(drops.find("\n" + std::to_string(std::stoull(last)) + ",unknown,"), std::string::npos)
      << drops;
}

TEST(DeadRobot, ARobotThatEndsWithoutItsServerCompletesTheRecordAtTheNextStart) {
  const TemporaryFolder folder;
  const std::string drop_log = "buffer.drop_log=" + (folder / "drops").string();
  Server server(folder / "out");
  Process robot(robot_command(kRobot, server.address(),
                              {drop_log, "source.frames=1000000", "link.drain_timeout=0.1 s"}));
  ASSERT_TRUE(robot.wait_for_lines("] captured ", 2)) << robot.output();
  server.process().signal(SIGKILL);
  ASSERT_TRUE(robot.wait_for_line(", no connection")) << robot.output();
  robot.signal(SIGTERM);
  robot.wait();
  const auto session = read_record(folder / "out", kRobot).folder;
  EXPECT_NE(run({kOrbbufServer, "check", session}).status, 0);

  const Server again(folder / "out", {}, server.address());
  const Finished next = run(robot_command(kRobot, server.address(), {drop_log, "source.frames=3"}));
  EXPECT_EQ(next.status, 0) << next.output;
  const Finished check = run({kOrbbufServer, "check", session});
  EXPECT_EQ(check.status, 0) << check.output << next.output;
}

}  // namespace
}  // namespace orbbuf::test
