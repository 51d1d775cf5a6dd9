// SPDX-License-Identifier: Apache-2.0
// A stalled connection and the one tried beside it: whichever moves first wins.
#include <gtest/gtest.h>

#include <csignal>

#include "tests/e2e/rig.hpp"
#include "tests/support/certificates.hpp"
#include "tests/support/namespaces.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRobot = "turtlebot1";

enum class Link { kPlain, kTls };

class StallTest : public ::testing::TestWithParam<Link> {
 protected:
  void SetUp() override {
    if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
    Overrides on_server{"listen.insecure=true"};
    Overrides on_robot{"source.frames=1000000", "source.width=640", "source.height=480"};
    if (GetParam() == Link::kTls) {
      const std::string listen = Namespaces::kServerListen;
      keys_.make("server", "127.0.0.1", listen.substr(0, listen.find(':')));
      on_server = Certificates::overrides(keys_.server());
      const Overrides keys = Certificates::overrides(keys_.robot());
      on_robot.insert(on_robot.end(), keys.begin(), keys.end());
    }
    server_ = std::make_unique<Server>(folder_ / "out", on_server, Namespaces::kServerListen,
                                       hosts_.on_server());
    robot_ = std::make_unique<Process>(
        robot_command(kRobot, server_->address(), on_robot, hosts_.on_robot()));
    ASSERT_TRUE(robot_->wait_for_lines("] captured ", 2));
  }

  /// `rule`: what the server's host does to packets that come in.
  void set_rule(const std::string& rule) {
    nft("add table inet some; add chain inet some in { type filter hook input priority 0; }; "
        "add rule inet some in " +
        rule);
  }
  void nft(const std::string& words) {
    std::vector<std::string> command = hosts_.on_server();
    command.insert(command.end(), {"nft", words});
    const Finished done = run(command);
    ASSERT_EQ(done.status, 0) << done.output;
  }

  int account_lines() const { return robot_->count_lines("] captured "); }
  void wait_seconds(int count) {  // by the robot's clock, which prints an account each
    ASSERT_TRUE(robot_->wait_for_lines("] captured ", account_lines() + count));
  }

  void end_and_expect_exactly_once() {
    robot_->signal(SIGTERM);
    ASSERT_EQ(robot_->wait(), 0) << robot_->output();
    const auto account = closing_account(*robot_);
    const Record record = read_record(folder_ / "out", kRobot);
    expect_exactly_once(record, account.at("captured"));
    EXPECT_EQ(record.delivered.size(), account.at("acknowledged"));
  }

  const Namespaces hosts_;
  const Certificates keys_;
  const TemporaryFolder folder_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<Process> robot_;
};

TEST_P(StallTest, TheOldConnectionGoesOnIfItIsTheFirstToMove) {
  hosts_.cut_link();
  ASSERT_TRUE(robot_->wait_for_line("stalled"));
  set_rule("tcp flags & (syn | ack) == syn drop");  // nothing new comes in
  hosts_.mend_link();
  EXPECT_TRUE(robot_->wait_for_line("moves again", std::chrono::seconds(10))) << robot_->output();
  nft("delete table inet some");
  EXPECT_EQ(robot_->count_lines("connected to"), 1) << robot_->output();
  end_and_expect_exactly_once();
}

TEST_P(StallTest, TheNewConnectionTakesOverIfTheOldOneDoesNotMove) {
  const auto line = server_->process().wait_for_line("turtlebot1 10.77.0.1:");
  ASSERT_TRUE(line);
  const std::string old_port = line->substr(line->find("10.77.0.1:") + 10, 5);
  set_rule("tcp sport " + old_port.substr(0, old_port.find(':')) + " drop");
  EXPECT_TRUE(robot_->wait_for_lines("connected to", 2, std::chrono::seconds(10)))
      << robot_->output();
  EXPECT_TRUE(server_->process().wait_for_line("replaced")) << server_->process().output();
  end_and_expect_exactly_once();
}

// The window's opening is lost in the outage, and nothing is outstanding but the kernel's probes,
// which it sends ever more rarely.
TEST_P(StallTest, AWindowThatOpensDuringAnOutageIsNotSleptOn) {
  server_->process().signal(SIGSTOP);
  wait_seconds(2);
  nft("add table inet some; add chain inet some in { type filter hook input priority 0; policy "
      "drop; "
      "}; add chain inet some out { type filter hook output priority 0; policy drop; }");
  server_->process().signal(SIGCONT);
  wait_seconds(8);
  const fs::path images = read_record(folder_ / "out", kRobot).folder / "images";
  Process watch({ORBBUF_LINK_PEER, "watch", images.string()});  // a line for each frame
  ASSERT_TRUE(watch.wait_for_line("watching"));
  nft("delete table inet some");
  const auto returned = std::chrono::steady_clock::now();
  ASSERT_TRUE(watch.wait_for_lines("", 2)) << watch.output();
  const std::chrono::duration<double> wait = std::chrono::steady_clock::now() - returned;
  EXPECT_LT(wait.count(), 1.5) << robot_->output();
  end_and_expect_exactly_once();
}

INSTANTIATE_TEST_SUITE_P(Over, StallTest, ::testing::Values(Link::kPlain, Link::kTls),
                         [](const auto& link) {
                           return link.param == Link::kTls ? "Tls" : "PlainTcp";
                         });

}  // namespace
}  // namespace orbbuf::test
