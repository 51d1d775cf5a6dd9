// SPDX-License-Identifier: Apache-2.0
// Robots that know two servers, of which one is killed, cut off, or not the one it should be.
#include <gtest/gtest.h>

#include <csignal>

#include "testing/certificates.hpp"
#include "testing/namespaces.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

class Servers : public ::testing::Test {
 protected:
  std::unique_ptr<Process> robot(const std::string& first, const std::string& second,
                                 Overrides overrides = {},
                                 const std::vector<std::string>& where = {}) const {
    for (const char* one : {"source.frames=1000000", "source.width=160", "source.height=120"}) {
      overrides.emplace_back(one);
    }
    return std::make_unique<Process>(
        robot_command(kRobot, "[\"" + first + "\", \"" + second + "\"]", overrides, where));
  }
  /// One more of the robot's lines, one a second.
  static void stream(Process& robot) {
    const int lines = robot.count_lines("] captured ");
    ASSERT_TRUE(robot.wait_for_lines("] captured ", lines + 1)) << robot.output();
  }
  /// The second server has each frame that the robot captured, or its name.
  void end_and_expect_all(Process& robot) const {
    robot.signal(SIGTERM);
    ASSERT_EQ(robot.wait(), 0) << robot.output();
    const Record record = read_record(folder_ / "second", kRobot);
    expect_exactly_once(record, closing_stats(robot).at("captured"));
    EXPECT_FALSE(record.delivered.empty());
  }

  const TemporaryFolder folder_;
};

TEST_F(Servers, TheStreamGoesOnAtTheOtherWhenOneIsKilled) {
  Server first(folder_ / "first");
  const Server second(folder_ / "second");
  const auto robot = this->robot(first.address(), second.address());
  ASSERT_TRUE(robot->wait_for_line("connected to " + first.address())) << robot->output();
  stream(*robot);
  first.process().signal(SIGKILL);
  ASSERT_TRUE(robot->wait_for_line("connected to " + second.address())) << robot->output();
  stream(*robot);
  end_and_expect_all(*robot);
  // What only the dead server has: nothing else is lost.
  const auto kept = read_record(folder_ / "first", kRobot).delivered.size();
  for (const auto& [sequence, why] : read_record(folder_ / "second", kRobot).dropped) {
    EXPECT_TRUE(why.find("lost") == std::string::npos || sequence < kept) << sequence;
  }
}

TEST_F(Servers, TheStreamGoesOnAtTheOtherWhenOneIsCutOff) {
  const Namespaces hosts(2);
  if (!hosts.exist()) GTEST_SKIP() << hosts.why();
  const Overrides insecure{"listen.insecure=true"};
  const Server first(folder_ / "first", insecure, Namespaces::kServerListen, hosts.on_server());
  const Server second(folder_ / "second", insecure, "10.78.0.2:0", hosts.on_server());
  const auto robot = this->robot(first.address(), second.address(), {}, hosts.on_robot());
  ASSERT_TRUE(robot->wait_for_line("connected to " + first.address())) << robot->output();
  stream(*robot);
  hosts.cut_link();
  ASSERT_TRUE(robot->wait_for_line("connected to " + second.address())) << robot->output();
  hosts.mend_link();
  stream(*robot);
  EXPECT_EQ(robot->count_lines("connected to"), 2) << robot->output();
  end_and_expect_all(*robot);
}

TEST_F(Servers, EachMustProveItsOwnNameUnderTls) {
  const Certificates keys;
  const auto robot_keys = Certificates::overrides(keys.robot());
  const auto server_keys = Certificates::overrides(keys.server());
  keys.make("server", "IP:127.0.0.1", "DNS:elsewhere");  // and localhost
  const Server first(folder_ / "first", server_keys);
  const Server second(folder_ / "second", server_keys);
  const std::string by_name = "localhost" + second.address().substr(second.address().rfind(':'));
  const auto robot = this->robot(first.address(), by_name, robot_keys);
  ASSERT_TRUE(robot->wait_for_line("connected to " + by_name)) << robot->output();
  EXPECT_TRUE(robot->wait_for_line("no connection to " + first.address() + ": no TLS"));
  end_and_expect_all(*robot);
}

}  // namespace
}  // namespace orbbuf::test
