// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/drain_socket.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <atomic>
#include <boost/asio/post.hpp>
#include <future>
#include <thread>

#include "testing/temporary_folder.hpp"

namespace orbbuf::fleet {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using Protocol = boost::asio::local::stream_protocol;
constexpr std::chrono::seconds kPatience{60};

/// A server's socket, asked from other threads than it runs on.
class DrainSocketTest : public testing::Test {
 protected:
  DrainSocketTest() {
    socket_ = std::make_unique<DrainSocket>(main_, path_, [this](DrainSocket::Done done) {
      done_ = std::move(done);
      ++drains_;
    });
    socket_->start();
    thread_ = std::thread([this] { main_.run(); });
  }
  ~DrainSocketTest() override {
    boost::asio::post(main_, [this] { socket_->stop(); });
    thread_.join();
  }

  std::future<std::optional<Error>> ask(std::chrono::seconds patience = kPatience) const {
    return std::async(std::launch::async, [this, patience] { return ask_drain(path_, patience); });
  }
  /// A client that may go away. It has been noticed.
  std::unique_ptr<Protocol::socket> come() {
    auto client = std::make_unique<Protocol::socket>(io_);
    client->connect({path_.string()});
    return client;
  }
  void wait_for_drains(int count) const {
    while (drains_ < count) std::this_thread::yield();
  }
  /// The server's drain ends.
  void end(const std::optional<Error>& error = std::nullopt) {
    std::promise<void> ended;
    boost::asio::post(main_, [&] {
      done_(error);
      ended.set_value();
    });
    ended.get_future().get();
  }
  /// What the client is told.
  static std::string told(Protocol::socket& client) {
    std::string line(100, '\0');
    boost::system::error_code failed;
    line.resize(client.read_some(boost::asio::buffer(line), failed));
    return line;
  }

  test::TemporaryFolder folder_;
  const std::filesystem::path path_ = folder_ / "status.drain";
  boost::asio::io_context io_;
  boost::asio::io_context main_{1};
  DrainSocket::Done done_;  // `main` only
  std::atomic<int> drains_ = 0;
  std::unique_ptr<DrainSocket> socket_;
  std::thread thread_;
};

TEST_F(DrainSocketTest, WhoAsksIsAnsweredWhenTheDrainIsDone) {
  auto first = ask();
  wait_for_drains(1);
  auto second = ask();
  EXPECT_EQ(first.wait_for(std::chrono::milliseconds(50)), std::future_status::timeout);
  end();
  EXPECT_FALSE(first.get());
  EXPECT_FALSE(second.get());
  EXPECT_FALSE(ask().get());  // who asks afterwards, too
  EXPECT_EQ(drains_, 1);
}

TEST_F(DrainSocketTest, AnErrorIsToldAndTheNextAsksAgain) {
  auto asked = ask();
  wait_for_drains(1);
  end(Error{"no other server"});
  const auto error = asked.get();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "no other server");
  asked = ask();
  wait_for_drains(2);
  end();
  EXPECT_FALSE(asked.get());
}

TEST_F(DrainSocketTest, ADrainThatTakesTooLongIsAnError) {
  const auto error = ask(std::chrono::seconds(1)).get();
  ASSERT_TRUE(error);
  EXPECT_THAT(error->text, EndsWith("status.drain: robots are still there"));
}

TEST_F(DrainSocketTest, AServerThatEndsWithoutAnAnswerIsAnErrorAtOnce) {
  auto asked = ask();
  wait_for_drains(1);
  boost::asio::post(main_, [this] { socket_->stop(); });
  const auto error = asked.get();
  ASSERT_TRUE(error);
  EXPECT_THAT(error->text, EndsWith("status.drain: the server ended without an answer"));
}

TEST_F(DrainSocketTest, AClientThatGoesAwayHoldsNobody) {
  auto gone = come();
  wait_for_drains(1);
  const auto stays = come();
  gone.reset();
  end();
  EXPECT_EQ(told(*stays), "drained\n");
}

TEST_F(DrainSocketTest, ItIsForThisUserAlone) {
  struct stat status {};
  ASSERT_EQ(::stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0077U, 0U);
}

TEST(DrainSocket, WhereNoServerListensIsAnError) {
  const test::TemporaryFolder folder;
  const auto error = ask_drain(folder / "none", kPatience);
  ASSERT_TRUE(error);
  EXPECT_THAT(error->text, HasSubstr("none: No such file or directory"));
}

TEST(DrainSocket, IsBesideTheStatusSocket) {
  EXPECT_EQ(drain_socket_of("/run/status"), "/run/status.drain");
  EXPECT_EQ(drain_socket_of(""), "");
}

}  // namespace
}  // namespace orbbuf::fleet
