// SPDX-License-Identifier: Apache-2.0
// The live page beside a stream: its stats are the robot's own, and no visitor costs a frame.
#include <gmock/gmock.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <csignal>
#include <random>

#include "common/address.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;
using testing::HasSubstr;

class PageTest : public testing::Test {
 protected:
  PageTest() {
    const auto line = server_.process().wait_for_line("live page on http://").value();
    const std::size_t begin = line.find("//") + 2;
    page_ = parse_address(line.substr(begin, line.find('/', begin) - begin)).value();
  }

  asio::ip::tcp::socket visit(const std::string& bytes) {
    asio::ip::tcp::socket socket(io_);
    socket.connect({asio::ip::make_address(page_.host), page_.port});
    error_code closed;
    asio::write(socket, asio::buffer(bytes), closed);
    return socket;
  }
  std::string get(const std::string& path) {
    auto socket =
        visit("GET " + path + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    std::string answer;
    error_code ended;
    asio::read(socket, asio::dynamic_buffer(answer), ended);
    return answer;
  }
  Process robot(Overrides overrides) {
    overrides.insert(overrides.end(), {"source.kind=generated"});
    return Process(robot_command("robot", server_.address(), overrides));
  }

  asio::io_context io_;
  TemporaryFolder folder_;
  Server server_{folder_ / "out",
                 {"http.address=127.0.0.1:0", "status.socket=" + (folder_ / "status").string()}};
  Address page_;
};

TEST_F(PageTest, AtTheEndPageMetricsAndStatusTellWhatTheRobotsLogTells) {
  Process robot = this->robot(
      {"source.frames=1000000", "source.fps=25", "buffer.policy=uniform", "buffer.capacity=5"});
  ASSERT_TRUE(robot.wait_for_line("connected to"));
  server_.process().signal(SIGSTOP);  // an outage, to the robot
  ASSERT_TRUE(wait_for_drops(robot)) << robot.output();
  server_.process().signal(SIGCONT);
  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  auto stats = closing_stats(robot);
  EXPECT_GT(stats["dropped"], 0U);
  EXPECT_EQ(stats["waiting"] + stats["in flight"], 0U);

  ASSERT_TRUE(server_.process().wait_for_line("the robot ended the session"));
  const std::string metrics = get("/metrics");
  const std::string json = get("/api/robots");
  for (const char* name : {"captured", "skipped", "failed", "dropped", "acknowledged"}) {
    const std::string count = std::to_string(stats[name]);
    EXPECT_THAT(metrics, HasSubstr(std::string("orbbuf_robot_") + name +
                                   "_total{robot=\"robot\"} " + count + "\n"));
    EXPECT_THAT(json, HasSubstr(std::string("\"") + name + "\":" + count + ","));
  }
  EXPECT_THAT(metrics, HasSubstr("orbbuf_frames_total{robot=\"robot\"} " +
                                 std::to_string(stats["acknowledged"]) + "\n"));
  EXPECT_THAT(json, HasSubstr("\"state\":\"ended\""));
  const Finished status = run({kOrbbufServer, "status", (folder_ / "status").string()});
  EXPECT_EQ(status.status, 0);
  EXPECT_THAT(status.output, testing::ContainsRegex("robot .* ended .* 0/5 +- +- +" +
                                                    std::to_string(stats["captured"]) + " +" +
                                                    std::to_string(stats["acknowledged"]) + " +" +
                                                    std::to_string(stats["dropped"]) + " "));
}

TEST_F(PageTest, StatusWithoutAServerSaysWhereItLooked) {
  const Finished status = run({kOrbbufServer, "status", (folder_ / "none").string()});
  EXPECT_EQ(status.status, 1);
  EXPECT_THAT(status.output, HasSubstr("no server answers: " + (folder_ / "none").string()));
}

TEST_F(PageTest, GarbageAndSlowVisitorsCostAStreamNothing) {
  constexpr int kRounds = 60;
  std::mt19937_64 random(1);
  std::vector<asio::ip::tcp::socket> slow;
  // A server that is merely slow is not left.
  Process robot = this->robot({"source.frames=200", "source.realtime=false",
                               "link.connect_timeout=60 s", "link.stall_timeout=60 s"});
  ASSERT_TRUE(robot.wait_for_line("connected to"));
  for (int round = 0; round < kRounds; ++round) {
    slow.push_back(visit("GET /api/robots HTTP/1.1\r\nHost: loc"));  // and no more
    slow.push_back(visit("GET /robots/robot/image HTTP/1.1\r\nHost: localhost\r\n\r\n"));
    std::string garbage(1 + random() % 20'000, '\0');
    for (char& byte : garbage) byte = static_cast<char>(random());
    visit(garbage);
    visit("GET / HTTP/1.1\r\n" + garbage);
    visit("POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n");
    visit("GET /sessions/robot/../../../etc/passwd HTTP/1.1\r\nHost: localhost\r\n\r\n");
  }
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  auto stats = closing_stats(robot);
  EXPECT_EQ(stats["acknowledged"], 200U);
  EXPECT_EQ(robot.count_lines("connection to"), 0) << robot.output();
  expect_exactly_once(read_record(folder_ / "out", "robot"), 200);
  slow.clear();
  EXPECT_THAT(get("/healthz"), HasSubstr("200 OK"));
}

}  // namespace
}  // namespace orbbuf::test
