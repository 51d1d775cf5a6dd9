// SPDX-License-Identifier: Apache-2.0
// The robot and the server with a long way between them.
#include <gtest/gtest.h>

#include <csignal>

#include "testing/certificates.hpp"
#include "testing/namespaces.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

constexpr const char* kRobot = "turtlebot1";
constexpr const char* kServer = "10.78.0.2";

class RoundTripTest : public ::testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
    path_ = std::make_unique<Process>(words(
        hosts_.on_robot(), {ORBBUF_LINK_PEER, "path", "near", "far", "1"}));  // there and back: 2 s
    if (!path_->wait_for_line("path from")) GTEST_SKIP() << path_->output();
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
  static std::vector<std::string> words(std::vector<std::string> host,
                                        const std::vector<std::string>& command) {
    host.insert(host.end(), command.begin(), command.end());
    return host;
  }

  const Namespaces hosts_;
  const Certificates keys_;
  const TemporaryFolder folder_;
  std::unique_ptr<Process> path_;
};

TEST_P(RoundTripTest, DefaultsConnectOverTwoSeconds) {
  Overrides on_server{"listen.insecure=true"};
  Overrides on_robot{"source.frames=1000000", "source.width=160", "source.height=120"};
  if (GetParam()) {
    keys_.make("server", "127.0.0.1", kServer);
    on_server = Certificates::overrides(keys_.server());
    on_robot = words(on_robot, Certificates::overrides(keys_.robot()));
  }
  Server server(folder_ / "out", on_server, std::string(kServer) + ":0", hosts_.on_server());
  Process robot(robot_command(kRobot, server.address(), on_robot, hosts_.on_robot()));
  ASSERT_TRUE(robot.wait_for_line("connected to")) << robot.output();
  ASSERT_TRUE(robot.wait_for_lines("] captured ", robot.count_lines("] captured ") + 2));
  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  EXPECT_EQ(robot.count_lines("connected to"), 1) << robot.output();
  expect_exactly_once(read_record(folder_ / "out", kRobot), closing_stats(robot).at("captured"));
}

INSTANTIATE_TEST_SUITE_P(Over, RoundTripTest, ::testing::Bool(),
                         [](const auto& is_tls) { return is_tls.param ? "Tls" : "PlainTcp"; });

}  // namespace
}  // namespace orbbuf::test
