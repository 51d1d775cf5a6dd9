// SPDX-License-Identifier: Apache-2.0
// Frames that the live stream passed over are at the server in the end, in the session's folder.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

class BackfillE2e : public ::testing::Test {
 protected:
  Overrides settings(Overrides more) const {
    Overrides all = {"source.width=320",      "source.height=240",
                     "source.frames=1000000", "buffer.policy=drop-oldest",
                     "buffer.capacity=3",     "spool.path=" + (folder_ / "spool").string()};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  /// Looks again and again: what changes is on the disk of another program.
  template <class Condition>
  static bool comes_true(Condition is_so) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
    while (!is_so()) {
      if (std::chrono::steady_clock::now() > deadline) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return true;
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
  const auto is_complete = [&] {
    const Finished check = run({kOrbbufServer, "check", record.folder});
    return check.output.find("0 on the robot, 0 dropped") != std::string::npos;
  };
  EXPECT_TRUE(comes_true(is_complete)) << server.process().output();
  EXPECT_EQ(run({kOrbbufServer, "check", record.folder}).status, 0);
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
  // At 25 frames a second, of four seconds all but the last one or two.
  const auto has_come = [&] { return read_lines(session / "times.txt").size() > live + 30; };
  EXPECT_TRUE(comes_true(has_come)) << again.process().output() << next.output();
}

}  // namespace
}  // namespace orbbuf::test
