// SPDX-License-Identifier: Apache-2.0
#include "common/progress.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string>

namespace orbbuf {
namespace {

using testing::MatchesRegex;

/// Stderr is a terminal of the test's own, as long as it lives.
class ProgressTest : public testing::Test {
 protected:
  void SetUp() override {
    int slave = -1;
    if (::openpty(&terminal_, &slave, nullptr, nullptr, nullptr) != 0) {
      GTEST_SKIP() << "no terminal to be had";
    }
    ::dup2(slave, STDERR_FILENO);
    ::close(slave);
  }
  ~ProgressTest() override {
    ::dup2(stderr_, STDERR_FILENO);
    ::close(stderr_);
    ::close(terminal_);
  }
  /// All that has been written since the last call. The kernel hands on what is written to a
  /// terminal later and in pieces: what is read ends with a mark that is written now.
  std::string shown() const {
    constexpr char kMark = '#';
    std::string all;
    if (::write(STDERR_FILENO, &kMark, 1) != 1) return all;
    while (!all.ends_with(kMark)) {
      std::array<char, 512> text{};
      const auto size = ::read(terminal_, text.data(), text.size());
      if (size <= 0) return all;
      all.append(text.data(), static_cast<std::size_t>(size));
    }
    all.pop_back();
    return all;
  }

 private:
  int terminal_ = -1;
  int stderr_ = ::dup(STDERR_FILENO);
};

TEST_F(ProgressTest, OnATerminalOneLineIsRewritten) {
  {
    Progress progress("export", "images", 10);
    std::string first;
    for (progress.add(4); first.empty(); progress.add(0)) first = shown();
    EXPECT_THAT(first,
                MatchesRegex("\rexport: 4 of 10 images, [0-9.]+ a second, [0-9]+ s remain +"));
    progress.add(6);
  }
  const std::string last = shown();
  EXPECT_THAT(last, MatchesRegex("(\r[^\r]*)*\rexport: 10 of 10 images,[^\r]*\r\n"));
}

TEST_F(ProgressTest, AShortJobIsSilent) {
  std::string said;
  std::chrono::nanoseconds taken{};
  do {  // until this thread was not held up
    const auto begin = std::chrono::steady_clock::now();
    Progress("check", "frames", 2).add(2);
    taken = std::chrono::steady_clock::now() - begin;
    said = shown();
  } while (taken >= std::chrono::milliseconds(200));
  EXPECT_EQ(said, "");
}

}  // namespace
}  // namespace orbbuf
