// SPDX-License-Identifier: Apache-2.0
#include "server/live/status_socket.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <boost/asio/write.hpp>
#include <fstream>
#include <memory>
#include <thread>

#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf::test {
namespace {

using testing::HasSubstr;
using testing::MatchesRegex;

/// A server's socket, asked from another thread than it runs on.
class StatusSocketTest : public testing::Test {
 protected:
  ~StatusSocketTest() override { stop(); }

  void start() {
    socket_ = std::make_unique<StatusSocket>(main_, path_, metrics_);
    socket_->start();
    thread_ = std::thread([this] { main_.run(); });
  }
  void stop() {
    main_.stop();
    if (thread_.joinable()) thread_.join();
    socket_.reset();
  }
  std::string failure() const { return ask_status(path_).error().text; }

  TemporaryFolder folder_;
  const std::string path_ = folder_ / "status";
  boost::asio::io_context main_{1};
  Metrics metrics_{8};
  std::unique_ptr<StatusSocket> socket_;
  std::thread thread_;
};

TEST_F(StatusSocketTest, GivesTheTableToWhoeverAsks) {
  const auto robot = metrics_.begin({"tb3", "s1", ""});
  robot->on_connected();
  robot->on_report({{120, 1, 2, 10, 100, 7, 0}, 25, 1000, 1'500'000, 40'000});
  robot->on_late(true);
  robot->on_spool(4, 9);
  metrics_.begin({"silent", "s2", ""})->on_ended();
  start();
  for (int i = 0; i < 2; ++i) {
    const std::string table = ask_status(path_).value();
    EXPECT_THAT(table, HasSubstr("ROBOT   SESSION  STATE      FRAMES/S  AGE  BUFFER"));
    EXPECT_THAT(table, HasSubstr("FAILED  LATE  ON ROBOT  QUALITY  REDUCED\n"));
    EXPECT_THAT(table, HasSubstr("silent  s2       ended           0.0    -       -"));
    EXPECT_THAT(table, HasSubstr("tb3     s1       connected       0.0    -    7/25  1.50 MB/s"));
    EXPECT_THAT(table, HasSubstr(" 40.0 ms       120        100       10        1       2     1    "
                                 "   4/9        -        0\n"));
  }
}

TEST_F(StatusSocketTest, IsItsUsersAloneAndGoneAtTheEnd) {
  start();
  struct stat status {};
  ASSERT_EQ(::stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0700U);
  stop();
  EXPECT_THAT(failure(), HasSubstr("no server answers: " + path_ + ": No such file"));
}

TEST_F(StatusSocketTest, WhatAServerLeftBehindIsReplaced) {
  { boost::asio::local::stream_protocol::acceptor killed(main_, path_); }
  EXPECT_THAT(failure(), HasSubstr("Connection refused"));
  start();
  EXPECT_THAT(ask_status(path_).value(), HasSubstr("ROBOT"));
}

TEST_F(StatusSocketTest, AnothersSocketIsLeftAlone) {
  start();
  try {
    StatusSocket second(main_, path_, metrics_);
    FAIL() << "took it";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(error.what(), "status.socket: another server is on " + path_);
  }
  EXPECT_THAT(ask_status(path_).value(), HasSubstr("ROBOT"));
}

TEST_F(StatusSocketTest, AFileThatIsNoSocketIsLeftAlone) {
  write_file(path_, "data");
  EXPECT_THROW(StatusSocket(main_, path_, metrics_), std::runtime_error);
  EXPECT_EQ(read_file(path_), "data");
}

TEST_F(StatusSocketTest, AServerThatStandsStillIsGivenUp) {
  boost::asio::local::stream_protocol::acceptor silent(main_, path_);
  EXPECT_THAT(failure(), HasSubstr(path_ + ": no answer"));
}

TEST_F(StatusSocketTest, ATableThatWasCutShortIsNone) {
  boost::asio::local::stream_protocol::acceptor hasty(main_, path_);
  hasty.async_accept([](const boost::system::error_code& /*failed*/, auto socket) {
    boost::asio::write(socket, boost::asio::buffer("ROBOT   SES", 11));
  });
  thread_ = std::thread([this] { main_.run(); });
  EXPECT_THAT(failure(), HasSubstr(path_ + ": the answer was cut short"));
}

TEST(StatusTable, TellsTheNewestQualityAndHowManyFramesAreReduced) {
  Metrics metrics(1);
  const auto robot = metrics.begin({"tb3", "s1", ""});
  for (Sequence i = 0; i < 2; ++i) {
    robot->on_delivered(std::make_shared<EncodedFrame>(reduced_frame(i)), RobotMetrics::Time());
  }
  EXPECT_THAT(to_table(metrics, RobotMetrics::Time()), HasSubstr("       30        2\n"));
}

TEST(StatusTable, HasItsHeadingWithoutRobots) {
  EXPECT_THAT(to_table(Metrics(1), RobotMetrics::Time()),
              MatchesRegex("ROBOT .*FAILED  LATE  ON ROBOT  QUALITY  REDUCED\n"));
}

}  // namespace
}  // namespace orbbuf::test
