// SPDX-License-Identifier: Apache-2.0
// The example of the package orbbuf-dev follows a live stream while the link and the server break.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <csignal>
#include <sstream>

#include "testing/namespaces.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

constexpr int kMore = 50;  // frames between one event and the next

class FollowTest : public testing::TestWithParam<const char*> {
 protected:
  /// At its end a session waits for the follower, which may be far behind.
  void start_server(const std::string& listen) {
    server_ = std::make_unique<Server>(
        folder_ / "out",
        Overrides{"listen.insecure=true", "robot.r.slam.fifo=" + (folder_ / "fifo").string(),
                  "robot.r.slam.format=" + std::string(GetParam()), "slam.resume=backlog",
                  "session.drain_timeout=2 min", "listen.idle_timeout=2 min"},
        listen, hosts_.on_server());
  }
  void restart_server() {
    const std::string address = server_->address();
    server_->process().wait();
    start_server(address);
  }
  /// Waits until the follower has seen kMore images more.
  bool sees_more() {
    return follower_->wait_for_lines(" camera 0: ", follower_->count_lines(" camera 0: ") + kMore);
  }
  std::vector<std::uint64_t> seen() const {
    std::vector<std::uint64_t> sequences;
    std::istringstream lines(follower_->output());
    for (std::string line; std::getline(lines, line);) {
      sequences.push_back(std::stoull(line.substr(line.find(' '))));
    }
    return sequences;
  }

  TemporaryFolder folder_;
  Namespaces hosts_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<Process> follower_;
};

TEST_P(FollowTest, EveryFrameIsSeenOnceThroughAnOutageAndRestartsOfTheServer) {
  if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
  const std::string fifo = folder_ / "fifo";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  start_server(Namespaces::kServerListen);
  follower_ = std::make_unique<Process>(std::vector<std::string>{kOrbbufFollow, fifo});
  Process robot(
      robot_command("r", server_->address(),
                    {"source.frames=1000000", "source.fps=50", "source.width=320",
                     "source.height=240", "buffer.capacity=1000", "link.drain_timeout=2 min"},
                    hosts_.on_robot()));
  ASSERT_TRUE(sees_more());

  hosts_.cut_link();
  ASSERT_TRUE(robot.wait_for_line("stalled, nothing acknowledged"));
  hosts_.mend_link();
  ASSERT_TRUE(sees_more());

  server_->process().signal(SIGKILL);
  restart_server();
  ASSERT_TRUE(sees_more());

  server_->process().signal(SIGTERM);
  restart_server();
  ASSERT_TRUE(sees_more());

  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  const Record record = read_record(folder_ / "out", "r");
  expect_exactly_once(record, closing_stats(robot).at("captured"));
  EXPECT_TRUE(follower_->wait_for_lines(" camera 0: ", static_cast<int>(record.delivered.size())));
  EXPECT_EQ(seen(), record.delivered);
}

INSTANTIATE_TEST_SUITE_P(Formats, FollowTest, testing::Values("pgm", "mjpeg"),
                         [](const auto& format) { return std::string(format.param); });

}  // namespace
}  // namespace orbbuf::test
