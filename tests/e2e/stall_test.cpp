// SPDX-License-Identifier: Apache-2.0
// A stalled connection and the one tried beside it: whichever moves first wins.
#include <gtest/gtest.h>

#include <csignal>

#include "tests/e2e/rig.hpp"
#include "tests/support/namespaces.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

class StallTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
    server_ = std::make_unique<Server>(folder_ / "out", Overrides{}, Namespaces::kServerListen,
                                       hosts_.on_server());
    robot_ = std::make_unique<Process>(robot_command(
        "r", server_->address(), {"source.frames=1000000", "source.width=640", "source.height=480"},
        hosts_.on_robot()));
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
    const Record record = read_record(folder_ / "out", "r");
    expect_exactly_once(record, account.at("captured"));
    EXPECT_EQ(record.delivered.size(), account.at("acknowledged"));
  }

  const Namespaces hosts_;
  const TemporaryFolder folder_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<Process> robot_;
};

TEST_F(StallTest, TheOldConnectionGoesOnIfItIsTheFirstToMove) {
  hosts_.cut_link();
  ASSERT_TRUE(robot_->wait_for_line("stalled"));
  set_rule("tcp flags & (syn | ack) == syn drop");  // nothing new comes in
  hosts_.mend_link();
  EXPECT_TRUE(robot_->wait_for_line("moves again", std::chrono::seconds(10))) << robot_->output();
  nft("delete table inet some");
  EXPECT_EQ(robot_->count_lines("connected to"), 1) << robot_->output();
  end_and_expect_exactly_once();
}

TEST_F(StallTest, TheNewConnectionTakesOverIfTheOldOneDoesNotMove) {
  const auto line = server_->process().wait_for_line("r 10.77.0.1:");
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
TEST_F(StallTest, AWindowThatOpensDuringAnOutageIsNotSleptOn) {
  server_->process().signal(SIGSTOP);
  wait_seconds(2);
  nft("add table inet some; add chain inet some in { type filter hook input priority 0; policy "
      "drop; "
      "}; add chain inet some out { type filter hook output priority 0; policy drop; }");
  server_->process().signal(SIGCONT);
  wait_seconds(8);
  const fs::path images = read_record(folder_ / "out", "r").folder / "images";
  Process watch({ORBBUF_LINK_PEER, "watch", images.string()});  // a line for each frame
  ASSERT_TRUE(watch.wait_for_line("watching"));
  nft("delete table inet some");
  const auto returned = std::chrono::steady_clock::now();
  ASSERT_TRUE(watch.wait_for_lines("", 2)) << watch.output();
  const std::chrono::duration<double> wait = std::chrono::steady_clock::now() - returned;
  EXPECT_LT(wait.count(), 1.5) << robot_->output();
  end_and_expect_exactly_once();
}

}  // namespace
}  // namespace orbbuf::test
