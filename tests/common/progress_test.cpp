// SPDX-License-Identifier: Apache-2.0
#include "common/progress.hpp"

#include <gtest/gtest.h>
#include <pty.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string>

namespace orbbuf {
namespace {

using std::chrono::milliseconds;

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
  Progress export_of(std::size_t images) {
    return {"export", "images", images, [this] { return now_; }};
  }
  void pass(milliseconds time) { now_ += time; }
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
  Progress::Clock::time_point now_{};
  int terminal_ = -1;
  int stderr_ = ::dup(STDERR_FILENO);
};

TEST_F(ProgressTest, OnATerminalOneLineIsRewritten) {
  {
    Progress progress = export_of(10);
    progress.add(1);
    pass(milliseconds(199));
    progress.add(1);
    EXPECT_EQ(shown(), "");
    pass(milliseconds(1));
    progress.add(2);
    EXPECT_EQ(shown(), "\rexport: 4 of 10 images, 20.0 a second, 0 s remain   ");
    pass(milliseconds(3800));
    progress.add(4);
    EXPECT_EQ(shown(), "\rexport: 8 of 10 images, 2.0 a second, 1 s remain   ");
    progress.add(2);
  }
  EXPECT_EQ(shown(), "\rexport: 10 of 10 images, 2.5 a second, 0 s remain   \r\n");
}

TEST_F(ProgressTest, AShortJobIsSilent) {
  {
    Progress progress = export_of(2);
    pass(milliseconds(199));
    progress.add(2);
  }
  EXPECT_EQ(shown(), "");
}

}  // namespace
}  // namespace orbbuf
