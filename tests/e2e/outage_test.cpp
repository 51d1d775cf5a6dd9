// SPDX-License-Identifier: Apache-2.0
// The link drops every packet until the robot drops frames, between two network namespaces.
#include <gtest/gtest.h>

#include <csignal>

#include "testing/namespaces.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace fs = std::filesystem;

struct Stream {
  const char* name;
  Overrides overrides;
  int seconds_before;  // the outage, on the robot's clock: it logs a line a second
};

void PrintTo(const Stream& stream, std::ostream* out) { *out << stream.name; }

class OutageTest : public ::testing::TestWithParam<Stream> {};

TEST_P(OutageTest, EveryFrameIsDeliveredOnceOrNamedAsDropped) {
  const Stream& stream = GetParam();
  Overrides overrides = stream.overrides;
  if (overrides.empty()) {
    const fs::path sequence = shared_sequence(stream.name);
    if (sequence.empty()) GTEST_SKIP() << "no ../shared/data/sequences/" << stream.name;
    overrides = {"source.kind=folder", "source.path=" + sequence.string(), "source.loop=true",
                 "buffer.capacity=10"};
  }
  const Namespaces hosts;
  if (!hosts.exist()) GTEST_SKIP() << hosts.why();
  const TemporaryFolder folder;
  Server server(folder / "out", {"listen.insecure=true"}, Namespaces::kServerListen,
                hosts.on_server());
  Process robot(robot_command("r", server.address(), overrides, hosts.on_robot()));

  const std::string account_line = "] captured ";
  ASSERT_TRUE(robot.wait_for_line("connected to")) << robot.output();
  ASSERT_TRUE(robot.wait_for_lines(account_line, stream.seconds_before));
  hosts.cut_link();
  ASSERT_TRUE(robot.wait_for_lines(account_line, robot.count_lines(account_line) + 3));
  ASSERT_TRUE(robot.wait_for_line("stalled, nothing acknowledged")) << robot.output();
  ASSERT_TRUE(wait_for_drops(robot)) << robot.output();
  hosts.mend_link();
  ASSERT_TRUE(robot.wait_for_lines(account_line, robot.count_lines(account_line) + 2));
  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();

  const auto stats = closing_stats(robot);
  const Record record = read_record(folder / "out", "r");
  expect_exactly_once(record, stats.at("captured"));
  EXPECT_EQ(record.delivered.size(), stats.at("acknowledged"));
  EXPECT_EQ(record.dropped.size(), stats.at("dropped") + stats.at("skipped") + stats.at("failed"));
}

INSTANTIATE_TEST_SUITE_P(Streams, OutageTest,
                         ::testing::Values(Stream{"kitti06_mono", {}, 1},
                                           Stream{"picar_indoor", {}, 5},
                                           Stream{"generated",
                                                  {"source.frames=1000000", "buffer.policy=uniform",
                                                   "source.width=320", "source.height=240"},
                                                  2}),
                         [](const auto& stream) { return stream.param.name; });

}  // namespace
}  // namespace orbbuf::test
