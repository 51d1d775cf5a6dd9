// SPDX-License-Identifier: Apache-2.0
// The robot and the server on a path that takes long, or that loses large packets.
#include <gtest/gtest.h>

#include <csignal>

#include "testing/certificates.hpp"
#include "testing/namespaces.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

constexpr const char* kServer = "10.78.0.2";

class PathTest : public ::testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
    if (GetParam()) {
      keys_.make("server", "127.0.0.1", kServer);
      on_server_ = Certificates::overrides(keys_.server());
      on_robot_ = Certificates::overrides(keys_.robot());
    }
  }
  /// seconds: one way.
  void make_path(const char* seconds) {
    path_ = std::make_unique<Process>(
        words(hosts_.on_robot(), {kOrbbufLinkPeer, "path", "near", "far", seconds}));
    ASSERT_TRUE(path_->wait_for_line("path from")) << path_->output();
    const std::string server = hosts_.on_server().back();
    for (const char* step : {"ip link set far netns SERVER", "ip addr add 10.78.0.1/24 dev near",
                             "ip link set near up", "ip -n SERVER addr add 10.78.0.2/24 dev far",
                             "ip -n SERVER link set far up"}) {
      std::string command = step;
      const auto at = command.find("SERVER");
      if (at != std::string::npos) command.replace(at, 6, server);
      const Finished done = run(words(hosts_.on_robot(), {"sh", "-c", command}));
      ASSERT_EQ(done.status, 0) << done.output;
    }
  }
  std::unique_ptr<Server> serve() const {
    return std::make_unique<Server>(folder_ / "out", on_server_, std::string(kServer) + ":0",
                                    hosts_.on_server());
  }
  std::unique_ptr<Process> send(const Server& server, const Overrides& more) const {
    const Overrides size{"source.width=160", "source.height=120"};
    return std::make_unique<Process>(robot_command(
        kRobot, server.address(), words(words(on_robot_, size), more), hosts_.on_robot()));
  }
  static std::vector<std::string> words(std::vector<std::string> host,
                                        const std::vector<std::string>& command) {
    host.insert(host.end(), command.begin(), command.end());
    return host;
  }

  const Namespaces hosts_;
  const Certificates keys_;
  const TemporaryFolder folder_;
  Overrides on_server_{"listen.insecure=true"};
  Overrides on_robot_;
  std::unique_ptr<Process> path_;
};

TEST_P(PathTest, DefaultsConnectOverARoundTripOfTwoSeconds) {
  make_path("1");
  const auto server = serve();
  const auto robot = send(*server, {"source.frames=1000000"});
  ASSERT_TRUE(robot->wait_for_line("connected to")) << robot->output();
  ASSERT_TRUE(robot->wait_for_lines("] captured ", robot->count_lines("] captured ") + 2));
  robot->signal(SIGTERM);
  ASSERT_EQ(robot->wait(), 0) << robot->output();
  EXPECT_EQ(robot->count_lines("connected to"), 1) << robot->output();
  expect_exactly_once(read_record(folder_ / "out", kRobot), closing_stats(*robot).at("captured"));
}

// An MTU black hole: nothing says that they were lost.
TEST_P(PathTest, LargePacketsThatVanishDoNotStopTheFrames) {
  make_path("0.005");
  for (const auto& host : {hosts_.on_robot(), hosts_.on_server()}) {
    const Finished done =
        run(words(host, {"nft",
                         "add table inet hole; add chain inet hole in { type filter hook input "
                         "priority 0; }; add rule inet hole in meta length > 700 drop"}));
    ASSERT_EQ(done.status, 0) << done.output;
  }
  const auto server = serve();
  const auto robot = send(*server, {"source.frames=50", "link.connect_timeout=1 s"});
  EXPECT_EQ(robot->wait(), 0) << robot->output();
  const Record record = read_record(folder_ / "out", kRobot);
  expect_exactly_once(record, 50);
  EXPECT_FALSE(record.delivered.empty()) << robot->output();
}

INSTANTIATE_TEST_SUITE_P(Over, PathTest, ::testing::Bool(),
                         [](const auto& is_tls) { return is_tls.param ? "Tls" : "PlainTcp"; });

}  // namespace
}  // namespace orbbuf::test
