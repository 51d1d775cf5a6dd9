// SPDX-License-Identifier: Apache-2.0
// A stalled connection and the one tried beside it: whichever moves first wins.
#include <gtest/gtest.h>

#include <csignal>

#include "testing/certificates.hpp"
#include "testing/namespaces.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

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
    // TCP's window holds less than the one frame that waits for an acknowledgement.
    on_server.emplace_back("listen.receive_buffer=\"8 KiB\"");
    server_ = std::make_unique<Server>(folder_ / "out", on_server, Namespaces::kServerListen,
                                       hosts_.on_server());
    robot_ = std::make_unique<Process>(
        robot_command(kRobot, server_->address(), on_robot, hosts_.on_robot()));
    ASSERT_TRUE(robot_->wait_for_line("connected to")) << robot_->output();
    ASSERT_TRUE(robot_->wait_for_lines("] captured ", 2));
  }

  /// `rule`: what the server's host does to packets that come in.
  void set_rule(const std::string& rule) {
    nft("add table inet some; add chain inet some in { type filter hook input priority 0; }; "
        "add rule inet some in " +
        rule);
  }
  void nft(const std::string& words) { on_host(hosts_.on_server(), {"nft", words}); }
  /// The robot's connection as its kernel has it.
  std::string connection() const {
    return on_host(hosts_.on_robot(), {"ss", "-tnoH", "state", "established"});
  }
  static std::string on_host(std::vector<std::string> host, const std::vector<std::string>& words) {
    host.insert(host.end(), words.begin(), words.end());
    const Finished done = run(host);
    EXPECT_EQ(done.status, 0) << done.output;
    return done.output;
  }

  /// Whether the robot's last stats says so; it logs one a second.
  bool is_stalled() const {
    const std::string log = robot_->output();
    return log.find("stalled", log.rfind("] captured ")) != std::string::npos;
  }
  /// Stops the server until nothing goes but the kernel's probes of its full window. It may be that
  /// the last of what was sent did not fit, and is sent again and again, or that the one frame in
  /// flight fits: then once more.
  bool stop_server_at_full_window() {
    bool stops = false;
    for (int second = 0; second < 60; ++second) {
      stops = !stops && !is_stalled();
      server_->process().signal(stops ? SIGSTOP : SIGCONT);
      const int lines = robot_->count_lines("] captured ");
      if (!robot_->wait_for_lines("] captured ", lines + 1)) return false;
      const bool is_full = connection().find("timer:(persist") != std::string::npos;
      if (stops && is_full && !is_stalled()) return true;
    }
    return false;
  }

  void end_and_expect_exactly_once() {
    robot_->signal(SIGTERM);
    ASSERT_EQ(robot_->wait(), 0) << robot_->output();
    const auto stats = closing_stats(*robot_);
    const Record record = read_record(folder_ / "out", kRobot);
    expect_exactly_once(record, stats.at("captured"));
    EXPECT_EQ(record.delivered.size(), stats.at("acknowledged"));
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
  EXPECT_TRUE(robot_->wait_for_line("recovered")) << robot_->output();
  nft("delete table inet some");
  EXPECT_EQ(robot_->count_lines("connected to"), 1) << robot_->output();
  end_and_expect_exactly_once();
}

TEST_P(StallTest, TheNewConnectionTakesOverIfTheOldOneDoesNotMove) {
  const std::string old = connection();  // ... 10.77.0.1:PORT 10.77.0.2:PORT ...
  const std::string robot = "10.77.0.1:";
  ASSERT_NE(old.find(robot), std::string::npos) << old;
  const std::string old_port = old.substr(old.find(robot) + robot.size());
  set_rule("tcp sport " + old_port.substr(0, old_port.find(' ')) + " drop");
  EXPECT_TRUE(robot_->wait_for_lines("connected to", 2)) << robot_->output();
  EXPECT_TRUE(server_->process().wait_for_line("replaced")) << server_->process().output();
  end_and_expect_exactly_once();
}

// The window's opening is lost in the outage, and nothing is outstanding but the kernel's probes,
// which it sends ever more rarely.
TEST_P(StallTest, AWindowThatOpensDuringAnOutageIsNotSleptOn) {
  ASSERT_TRUE(stop_server_at_full_window()) << robot_->output();
  const std::string stalled = "stalled, nothing acknowledged";
  const int stalls = robot_->count_lines(stalled);
  nft("add table inet some; add chain inet some in { type filter hook input priority 0; policy "
      "drop; "
      "}; add chain inet some out { type filter hook output priority 0; policy drop; }");
  server_->process().signal(SIGCONT);
  ASSERT_TRUE(robot_->wait_for_lines(stalled, stalls + 1)) << robot_->output();
  const fs::path images = read_record(folder_ / "out", kRobot).folder / "images";
  Process watch({kOrbbufLinkPeer, "watch", images.string()});  // a line for each frame
  ASSERT_TRUE(watch.wait_for_line("watching"));
  nft("delete table inet some");
  EXPECT_TRUE(watch.wait_for_lines("", 50)) << robot_->output();  // the window held fewer
  end_and_expect_exactly_once();
}

INSTANTIATE_TEST_SUITE_P(Over, StallTest, ::testing::Values(Link::kPlain, Link::kTls),
                         [](const auto& link) {
                           return link.param == Link::kTls ? "Tls" : "PlainTcp";
                         });

}  // namespace
}  // namespace orbbuf::test
