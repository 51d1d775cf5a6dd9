// SPDX-License-Identifier: Apache-2.0
#include "common/non_blocking_sink.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <memory>
#include <string>

#include "common/unique_fd.hpp"

namespace orbbuf {
namespace {

struct Ends {
  UniqueFd reading;
  UniqueFd writing;
};

Ends make_pipe() {
  std::array<int, 2> fds{};
  EXPECT_EQ(::pipe2(fds.data(), O_CLOEXEC), 0);
  ::fcntl(fds[0], F_SETFL, O_NONBLOCK);
  return {UniqueFd(fds[0]), UniqueFd(fds[1])};
}

Ends make_sockets() {
  std::array<int, 2> fds{};
  EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, fds.data()), 0);
  ::fcntl(fds[0], F_SETFL, O_NONBLOCK);
  return {UniqueFd(fds[0]), UniqueFd(fds[1])};
}

std::string read_all(const Ends& ends) {
  std::string all;
  std::array<char, 4096> piece{};
  for (ssize_t size = 0; (size = ::read(ends.reading.get(), piece.data(), piece.size())) > 0;) {
    all.append(piece.data(), static_cast<std::size_t>(size));
  }
  return all;
}

/// The lines of `text` that are `line`; each other one must be `other`.
int count_lines(const std::string& text, const std::string& line, const std::string& other) {
  int count = 0;
  EXPECT_TRUE(text.ends_with('\n'));
  for (std::size_t at = 0, end = 0; (end = text.find('\n', at)) != text.npos; at = end + 1) {
    const auto found = text.substr(at, end - at);
    count += found == line ? 1 : 0;
    EXPECT_TRUE(found == line || found == other) << found.substr(0, 200);
  }
  return count;
}

class NonBlockingSinkTest : public testing::TestWithParam<Ends (*)()> {
 protected:
  NonBlockingSinkTest() { log_.set_pattern("%v"); }

  Ends ends_ = GetParam()();
  spdlog::logger log_{"", std::make_shared<NonBlockingSink>(ends_.writing.get())};
};

TEST_P(NonBlockingSinkTest, LinesArriveInOrder) {
  log_.info("one");
  log_.info("two");
  EXPECT_EQ(read_all(ends_), "one\ntwo\n");
}

TEST_P(NonBlockingSinkTest, WhatNothingReadsIsLostAndCounted) {
  constexpr int kLines = 10'000;
  const std::string line(99, 'x');
  for (int i = 0; i < kLines; ++i) log_.info(line);  // far more than fits: must return
  std::string text = read_all(ends_);
  log_.info("at last");
  text += read_all(ends_);
  const auto at = text.rfind(" lines of the log were lost: stderr did not take them\nat last\n");
  ASSERT_NE(at, text.npos) << text.substr(text.size() - 300);
  const auto begin = text.rfind('\n', at) + 1;
  const int lost = std::stoi(text.substr(begin, at - begin));
  EXPECT_GT(lost, 0);
  EXPECT_EQ(count_lines(text.substr(0, begin), line, ""), kLines - lost);
}

TEST_P(NonBlockingSinkTest, ALongLineIsNotCut) {
  const std::string line(30'000, 'x');
  for (int i = 0; i < 100; ++i) log_.info(line);
  std::string text = read_all(ends_);
  log_.info("y");
  text += read_all(ends_);
  const auto lost = text.find(" lines of the log were lost");
  ASSERT_NE(lost, text.npos);
  EXPECT_GT(count_lines(text.substr(0, text.rfind('\n', lost) + 1), line, ""), 0);
}

TEST_P(NonBlockingSinkTest, AReaderThatIsGoneDoesNoHarm) {
  const bool is_pipe = GetParam() == &make_pipe;
  // A socket raises no signal, which would end this test. That of a pipe the programs ignore.
  const auto before = std::signal(SIGPIPE, is_pipe ? SIG_IGN : SIG_DFL);
  ends_.reading = UniqueFd();
  log_.info("one");
  log_.info("two");
  std::signal(SIGPIPE, before);
  if (!is_pipe) return;  // a socket has no second reader
  const auto path = "/proc/self/fd/" + std::to_string(ends_.writing.get());
  ends_.reading = UniqueFd(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  log_.info("three");
  EXPECT_EQ(read_all(ends_), "2 lines of the log were lost: stderr did not take them\nthree\n");
}

INSTANTIATE_TEST_SUITE_P(Of, NonBlockingSinkTest, testing::Values(&make_pipe, &make_sockets),
                         [](const auto& test) { return test.index == 0 ? "Pipe" : "Sockets"; });

}  // namespace
}  // namespace orbbuf
