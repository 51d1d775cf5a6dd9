// SPDX-License-Identifier: Apache-2.0
// Frames that the live stream passed over are at the server in the end, in the session's folder.
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>

#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

class BackfillE2e : public ::testing::Test {
 protected:
  Overrides settings(Overrides more) const {
    Overrides all = {"source.width=320",
                     "source.height=240",
                     "source.frames=1000000",
                     "buffer.policy=drop-oldest",
                     "buffer.capacity=3",
                     "buffer.drop_log=" + (folder_ / "drops").string(),
                     "spool.path=" + (folder_ / "spool").string()};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  /// Until the robot has nothing more of it, and the server has put it together.
  static void expect_complete(Server& server, const std::filesystem::path& session) {
    const std::string name = session.filename().string();
    ASSERT_TRUE(server.process().wait_for_line(name + ": ")) << server.process().output();
    ASSERT_TRUE(server.process().wait_for_line("late frames have completed the session"))
        << server.process().output();
    const Finished check = run({ORBBUF_SERVER, "check", session});
    EXPECT_NE(check.output.find("0 on the robot, 0 lost"), std::string::npos) << check.output;
    EXPECT_FALSE(std::filesystem::exists(session / "late"));
  }

  const TemporaryFolder folder_;
};

TEST_F(BackfillE2e, AfterAnOutageAllFramesOfTheSessionArrive) {
  Server server(folder_ / "out");
  Process robot(robot_command(kRobot, server.address(), settings({})));
  ASSERT_TRUE(robot.wait_for_line("connected to")) << robot.output();
  server.process().signal(SIGSTOP);
  ASSERT_TRUE(wait_for_drops(robot));
  server.process().signal(SIGCONT);
  const std::string all_sent = " spooled 0";
  ASSERT_TRUE(robot.wait_for_lines(all_sent, robot.count_lines(all_sent) + 2)) << robot.output();
  robot.signal(SIGTERM);
  EXPECT_EQ(robot.wait(), 0) << robot.output();
  const Record record = read_record(folder_ / "out", kRobot);
  expect_complete(server, record.folder);
  EXPECT_EQ(run({ORBBUF_SERVER, "check", record.folder}).status, 0);
}

TEST_F(BackfillE2e, ARobotKilledWhileTheServerIsAwaySendsTheRestInItsNextSession) {
  Server server(folder_ / "out");
  Process dead(robot_command(kRobot, server.address(), settings({})));
  ASSERT_TRUE(dead.wait_for_line("connected to")) << dead.output();
  const std::string account = "] captured ";
  ASSERT_TRUE(dead.wait_for_lines(account, 2));
  server.process().signal(SIGKILL);
  ASSERT_TRUE(dead.wait_for_line(", no connection")) << dead.output();
  ASSERT_TRUE(dead.wait_for_lines(account, dead.count_lines(account) + 4));
  dead.signal(SIGKILL);
  dead.wait();
  const auto session = read_record(folder_ / "out", kRobot).folder;
  const std::size_t live = read_record(folder_ / "out", kRobot).delivered.size();

  Server again(folder_ / "out", {}, server.address());
  const Process next(robot_command(kRobot, server.address(), settings({"source.fps=5"})));
  ASSERT_TRUE(again.process().wait_for_line(session.filename().string() + ": ")) << next.output();
  ASSERT_TRUE(again.process().wait_for_line("late frames have completed the session"))
      << again.process().output() << next.output();
  const std::string times = read_file(session / "times.txt");
  // At 25 frames a second, of four seconds all but the last one or two.
  EXPECT_GT(static_cast<std::size_t>(std::count(times.begin(), times.end(), '\n')), live + 30);
}

}  // namespace
}  // namespace orbbuf::test
