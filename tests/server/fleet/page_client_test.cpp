// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/page_client.hpp"

#include <gmock/gmock.h>

#include <array>
#include <boost/asio/write.hpp>
#include <deque>

#include "tests/server/event_loop.hpp"

namespace orbbuf::fleet {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;

/// A page that says what it is told to, request by request; a client that has little patience.
class PageClientTest : public test::EventLoop {
 protected:
  PageClientTest() { accept(); }
  ~PageClientTest() override {
    client_->close();
    acceptor_.close();
    sockets_.clear();
    run_ready();
  }

  Result<std::optional<std::string>> get(const std::string& path) {
    std::optional<Result<std::optional<std::string>>> answer;
    client_->async_get(path, [&](auto got) { answer = std::move(got); });
    EXPECT_FALSE(answer);
    EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
    return *std::move(answer);
  }
  void say(const std::string& answer) { answers_.push_back(answer); }
  /// The page does.
  void hang_up() { sockets_.clear(); }

  void accept() {
    acceptor_.async_accept([this](const auto& failed, tcp::socket socket) {
      if (failed) return;
      sockets_.push_back(std::make_unique<tcp::socket>(std::move(socket)));
      read(*sockets_.back());
      accept();
    });
  }
  void read(tcp::socket& socket) {
    socket.async_read_some(asio::buffer(block_), [this, &socket](const auto& failed, auto bytes) {
      if (failed) return;
      requests_.append(block_.data(), bytes);
      if (!answers_.empty()) {
        asio::write(socket, asio::buffer(answers_.front()));
        answers_.pop_front();
      }
      read(socket);
    });
  }

  tcp::acceptor acceptor_{main_, tcp::endpoint(asio::ip::address_v4::loopback(), 0)};
  std::deque<std::unique_ptr<tcp::socket>> sockets_;
  std::array<char, 4096> block_{};
  std::deque<std::string> answers_;
  std::string requests_;
  std::shared_ptr<PageClient> client_ =
      std::make_shared<PageClient>(main_, Address{"127.0.0.1", acceptor_.local_endpoint().port()},
                                   std::chrono::milliseconds(300));
};

const std::string kHello = "HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nhello";

TEST_F(PageClientTest, SeveralFilesComeOverOneConnection) {
  say(kHello);
  say("HTTP/1.1 404 Not Found\r\nContent-Length: 2\r\n\r\nno");
  say(kHello);
  EXPECT_EQ(get("/a").value(), "hello");
  EXPECT_EQ(get("/b").value(), std::nullopt);
  EXPECT_EQ(get("/c").value(), "hello");
  EXPECT_EQ(sockets_.size(), 1U);
  EXPECT_THAT(requests_, testing::StartsWith("GET /a HTTP/1.1\r\nHost: 127.0.0.1:"));
}

TEST_F(PageClientTest, AConnectionThatThePageHasEndedIsMadeAgain) {
  say(kHello);
  EXPECT_EQ(get("/a").value(), "hello");
  hang_up();
  say(kHello);
  EXPECT_EQ(get("/b").value(), "hello");
  say("HTTP/1.1 200 OK\r\nContent-Length: 3\r\nConnection: close\r\n\r\nbye");
  EXPECT_EQ(get("/c").value(), "bye");
  say(kHello);
  EXPECT_EQ(get("/d").value(), "hello");
  EXPECT_EQ(sockets_.size(), 2U);
}

TEST_F(PageClientTest, AnotherStatusIsAnError) {
  say("HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\n\r\n");
  const auto answer = get("/a");
  ASSERT_FALSE(answer);
  EXPECT_THAT(answer.error().text, testing::HasSubstr("/a: HTTP 503"));
}

TEST_F(PageClientTest, APageThatDoesNotAnswerIsAnErrorSoon) {
  const auto silent = get("/a");
  ASSERT_FALSE(silent);
  EXPECT_THAT(silent.error().text, testing::HasSubstr("no answer"));
  say("HTTP/1.1 200 OK\r\nContent-Length: 500\r\n\r\nhalf");
  const auto half = get("/b");
  EXPECT_FALSE(half);
  say(kHello);
  EXPECT_EQ(get("/c").value(), "hello");
}

TEST_F(PageClientTest, APageThatIsNotThereIsAnError) {
  acceptor_.close();
  const auto answer = get("/a");
  ASSERT_FALSE(answer);
  EXPECT_THAT(answer.error().text, testing::HasSubstr("no answer"));
}

TEST_F(PageClientTest, CloseEndsACall) {
  std::optional<bool> has_answer;
  client_->async_get("/a", [&](const auto& got) { has_answer = got.has_value(); });
  ASSERT_TRUE(run_until([&] { return !requests_.empty(); }));
  client_->close();
  ASSERT_TRUE(run_until([&] { return has_answer.has_value(); }));
  EXPECT_FALSE(*has_answer);
  EXPECT_FALSE(get("/b"));
}

}  // namespace
}  // namespace orbbuf::fleet
