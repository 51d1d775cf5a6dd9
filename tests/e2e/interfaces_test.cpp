// SPDX-License-Identifier: Apache-2.0
// Two links between robot and server, of which either is cut while the frames go on.
#include <gtest/gtest.h>

#include <csignal>

#include "testing/certificates.hpp"
#include "testing/namespaces.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

constexpr const char* kFirst = Namespaces::kLink;
constexpr const char* kSecond = Namespaces::kSecondLink;

/// The parameter: whether it is under TLS.
class InterfacesTest : public ::testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
    Overrides overrides{"listen.insecure=true"};
    if (GetParam()) {
      keys_ = std::make_unique<Certificates>();
      keys_->make("server", "127.0.0.1", "10.79.0.2");
      overrides = Certificates::overrides(keys_->server());
    }
    server_ = std::make_unique<Server>(folder_ / "out", overrides, Namespaces::kServerListenOnBoth,
                                       hosts_.on_server());
  }
  void start() {
    Overrides overrides = {std::string("link.interfaces=[\"") + kFirst + "\", \"" + kSecond + "\"]",
                           "link.return_after=1 s",
                           "source.frames=1000000",
                           "source.width=320",
                           "source.height=240",
                           "source.fps=25"};
    const Overrides tls = keys_ ? Certificates::overrides(keys_->robot()) : Overrides{};
    overrides.insert(overrides.end(), tls.begin(), tls.end());
    robot_ = std::make_unique<Process>(
        robot_command(kRobot, server_->address(), overrides, hosts_.on_robot()));
  }
  /// Whether the robot has connected that often over that interface.
  bool is_over(const std::string& interface, int times) const {
    return robot_->wait_for_lines("over " + interface + "; its record", times);
  }
  /// Two more of the robot's lines, one a second.
  void stream() const {
    const int lines = robot_->count_lines("] captured ");
    ASSERT_TRUE(robot_->wait_for_lines("] captured ", lines + 2)) << robot_->output();
  }
  /// Nothing lost, repeated or unexplained, and no more than two frames in a row not delivered.
  void end_and_expect_no_gap() {
    robot_->signal(SIGTERM);
    ASSERT_EQ(robot_->wait(), 0) << robot_->output();
    const auto stats = closing_stats(*robot_);
    const Record record = read_record(folder_ / "out", kRobot);
    expect_exactly_once(record, stats.at("captured"));
    EXPECT_EQ(record.delivered.size(), stats.at("acknowledged"));
    std::uint64_t next = 0;
    for (const std::uint64_t sequence : record.delivered) {
      EXPECT_LE(sequence - next, 2U) << robot_->output();
      next = sequence + 1;
    }
  }

  const Namespaces hosts_{2};
  const TemporaryFolder folder_;
  std::unique_ptr<Certificates> keys_;  // null: plain TCP
  std::unique_ptr<Server> server_;
  std::unique_ptr<Process> robot_;
};

TEST_P(InterfacesTest, EitherLinkMayFailAndThePreferredOneIsUsedAgain) {
  start();
  ASSERT_TRUE(is_over(kFirst, 1)) << robot_->output();
  stream();
  for (int times = 1; times <= 2; ++times) {
    hosts_.cut_link(kFirst);
    ASSERT_TRUE(is_over(kSecond, times)) << robot_->output();
    stream();
    hosts_.mend_link(kFirst);
    ASSERT_TRUE(is_over(kFirst, times + 1)) << robot_->output();
    stream();
  }
  EXPECT_EQ(robot_->count_lines("stalled, nothing acknowledged"), 2) << robot_->output();
  hosts_.cut_link(kSecond);  // which carries nothing
  stream();
  EXPECT_EQ(robot_->count_lines("connected to"), 5) << robot_->output();
  EXPECT_EQ(robot_->count_lines("stalled, nothing acknowledged"), 2) << robot_->output();
  hosts_.mend_link(kSecond);
  end_and_expect_no_gap();
}

TEST_P(InterfacesTest, TheOneThatReturnsFirstIsUsedWhenBothHaveFailed) {
  start();
  ASSERT_TRUE(is_over(kFirst, 1)) << robot_->output();
  hosts_.cut_link(kSecond);
  hosts_.cut_link(kFirst);
  ASSERT_TRUE(robot_->wait_for_line("stalled, nothing acknowledged")) << robot_->output();
  hosts_.mend_link(kSecond);
  ASSERT_TRUE(is_over(kSecond, 1)) << robot_->output();
  hosts_.mend_link(kFirst);
  ASSERT_TRUE(is_over(kFirst, 2)) << robot_->output();
  robot_->signal(SIGTERM);
  ASSERT_EQ(robot_->wait(), 0) << robot_->output();
  expect_exactly_once(read_record(folder_ / "out", kRobot), closing_stats(*robot_).at("captured"));
}

INSTANTIATE_TEST_SUITE_P(Over, InterfacesTest, ::testing::Bool(),
                         [](const auto& is_tls) { return is_tls.param ? "Tls" : "PlainTcp"; });

}  // namespace
}  // namespace orbbuf::test
