// SPDX-License-Identifier: Apache-2.0
#include "server/live/control_socket.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <cstdlib>
#include <future>
#include <memory>
#include <thread>
#include <vector>

#include "testing/temporary_folder.hpp"

namespace orbbuf::test {
namespace {

using testing::HasSubstr;
using Protocol = boost::asio::local::stream_protocol;
constexpr std::chrono::seconds kPatience{60};

/// A server's socket, asked from other threads than it runs on. `name` answers at once, `wait` when
/// the test says so.
class ControlSocketTest : public testing::Test {
 protected:
  ~ControlSocketTest() override { stop(); }

  std::unique_ptr<ControlSocket> make() {
    return std::make_unique<ControlSocket>(
        main_, path_,
        std::map<std::string, ControlSocket::Command>{
            {"name", [](const ControlSocket::Answer& answer) { answer(std::string("server\n")); }},
            {"wait", [this](ControlSocket::Answer answer) {
               waiting_.push_back(std::move(answer));
               ++waits_;
             }}});
  }
  void start() {
    socket_ = make();
    socket_->start();
    run();
  }
  void run() {
    thread_ = std::thread([this] { main_.run(); });
  }
  void stop() {
    main_.stop();
    if (thread_.joinable()) thread_.join();
    waiting_.clear();
    socket_.reset();
  }
  Result<std::string> ask(const std::string& word,
                          std::chrono::seconds patience = kPatience) const {
    return ask_server(path_, word, patience);
  }
  std::future<Result<std::string>> ask_later(const std::string& word) const {
    return std::async(std::launch::async, [this, word] { return ask(word); });
  }
  std::string failure(std::chrono::seconds patience = kPatience) const {
    return ask("name", patience).error().text;
  }
  void wait_for(int waits) const {
    while (waits_ < waits) std::this_thread::yield();
  }
  void on_main(const std::function<void()>& work) {
    std::promise<void> done;
    boost::asio::post(main_, [&] {
      work();
      done.set_value();
    });
    done.get_future().get();
  }

  TemporaryFolder folder_;
  const std::string path_ = folder_ / "status";
  boost::asio::io_context main_{1};
  std::vector<ControlSocket::Answer> waiting_;  // `main` only
  std::atomic<int> waits_ = 0;
  std::unique_ptr<ControlSocket> socket_;
  std::thread thread_;
};

TEST_F(ControlSocketTest, AnswersEachClient) {
  start();
  EXPECT_EQ(ask("name").value(), "server\n");
  EXPECT_EQ(ask("name").value(), "server\n");
}

TEST_F(ControlSocketTest, RefusesAWordThatItDoesNotKnow) {
  start();
  EXPECT_THAT(ask("drain").error().text, HasSubstr("the server has no command drain"));
  EXPECT_EQ(ask("name").value(), "server\n");
}

TEST_F(ControlSocketTest, AnAnswerMayComeLater) {
  start();
  auto first = ask_later("wait");
  auto second = ask_later("wait");
  wait_for(2);
  EXPECT_EQ(ask("name").value(), "server\n");
  on_main([this] {
    waiting_[0](Error{"not now"});
    waiting_[1](Error{"not now"});
    waiting_.clear();
  });
  EXPECT_THAT(first.get().error().text, HasSubstr("status: not now"));
  EXPECT_FALSE(second.get());
}

TEST_F(ControlSocketTest, AClientThatHasGoneCostsNothing) {
  start();
  boost::asio::io_context io;
  {
    Protocol::socket gone(io);
    gone.connect({path_});
    boost::asio::write(gone, boost::asio::buffer("wait\n", 5));
    wait_for(1);
  }
  on_main([this] { std::exchange(waiting_, {})[0](std::string("too late\n")); });
  EXPECT_EQ(ask("name").value(), "server\n");
}

TEST_F(ControlSocketTest, AClientThatSaysNothingIsLeft) {
  start();
  boost::asio::io_context io;
  Protocol::socket silent(io);
  silent.connect({path_});
  std::string answer;
  boost::system::error_code end;
  boost::asio::read(silent, boost::asio::dynamic_buffer(answer), end);
  EXPECT_EQ(end, boost::asio::error::eof);
  EXPECT_EQ(answer, "");
}

TEST_F(ControlSocketTest, AnEndlessWordIsNotRead) {
  start();
  EXPECT_FALSE(ask(std::string(100'000, 'x')));
  EXPECT_EQ(ask("name").value(), "server\n");
}

TEST_F(ControlSocketTest, AServerThatEndsWithoutAnAnswerIsAnErrorAtOnce) {
  start();
  auto asked = ask_later("wait");
  wait_for(1);
  on_main([this] { socket_->stop(); });
  EXPECT_THAT(asked.get().error().text, HasSubstr(path_ + ": the server ended without an answer"));
}

TEST_F(ControlSocketTest, IsItsUsersAloneAndGoneAtTheEnd) {
  start();
  struct stat status {};
  ASSERT_EQ(::stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0700U);
  stop();
  EXPECT_THAT(failure(), HasSubstr("no server answers: " + path_ + ": No such file"));
}

TEST_F(ControlSocketTest, WithoutAFolderOfTheUserTheErrorSaysSo) {
  const char* const folder = std::getenv("XDG_RUNTIME_DIR");
  const std::string before = folder == nullptr ? "" : folder;
  ::unsetenv("XDG_RUNTIME_DIR");
  const auto answer = ask_server(kAutomaticSocket, "name", std::chrono::seconds(1));
  if (folder != nullptr) ::setenv("XDG_RUNTIME_DIR", before.c_str(), 1);
  if (answer) GTEST_SKIP() << "the service runs on this machine";
  EXPECT_THAT(answer.error().text, HasSubstr("since XDG_RUNTIME_DIR is not set"));
}

TEST_F(ControlSocketTest, WhatAServerLeftBehindIsReplaced) {
  { Protocol::acceptor killed(main_, path_); }
  EXPECT_THAT(failure(), HasSubstr("Connection refused"));
  start();
  EXPECT_EQ(ask("name").value(), "server\n");
}

TEST_F(ControlSocketTest, AnothersSocketIsLeftAlone) {
  start();
  try {
    make();
    FAIL() << "took it";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(error.what(), "status.socket: another server is on " + path_);
  }
  EXPECT_EQ(ask("name").value(), "server\n");
}

TEST_F(ControlSocketTest, AFileThatIsNoSocketIsLeftAlone) {
  write_file(path_, "data");
  EXPECT_THROW(make(), std::runtime_error);
  EXPECT_EQ(read_file(path_), "data");
}

TEST_F(ControlSocketTest, AServerThatStandsStillIsGivenUp) {
  Protocol::acceptor silent(main_, path_);
  EXPECT_THAT(failure(std::chrono::seconds(1)), HasSubstr(path_ + ": no answer"));
}

TEST_F(ControlSocketTest, AnAnswerThatWasCutShortIsNone) {
  Protocol::acceptor hasty(main_, path_);
  hasty.async_accept([](const boost::system::error_code& /*failed*/, auto socket) {
    boost::asio::write(socket, boost::asio::buffer("ok\nROBOT   SES", 14));
  });
  run();
  EXPECT_THAT(failure(), HasSubstr(path_ + ": the answer was cut short"));
}

}  // namespace
}  // namespace orbbuf::test
