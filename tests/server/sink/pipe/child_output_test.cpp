// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/child_output.hpp"

#include <gtest/gtest.h>

#include "testing/captured_log.hpp"

namespace orbbuf {
namespace {

using Lines = std::vector<std::string>;
using std::chrono::seconds;

class OutputLogTest : public testing::Test {
 protected:
  void add_lines(int count) {
    for (int i = 0; i < count; ++i) output_.add("line\n", now_);
  }

  test::CapturedLog log_;
  OutputLog output_{"r s: slam"};
  OutputLog::Moment now_{seconds(1000)};
};

TEST_F(OutputLogTest, LinesComeTogetherFromPieces) {
  output_.add("tra", now_);
  output_.add("cking lost\nat 1", now_);
  EXPECT_EQ(log_.lines(), (Lines{"info r s: slam: tracking lost"}));
  output_.add("2\n\n\n", now_);
  output_.add("10 %\r20 %\r\n", now_);
  EXPECT_EQ(log_.lines(), (Lines{"info r s: slam: tracking lost", "info r s: slam: at 12",
                                 "info r s: slam: 10 %", "info r s: slam: 20 %"}));
}

TEST_F(OutputLogTest, TheLastLineNeedsNoEnd) {
  output_.add("aborted", now_);
  output_.end(now_);
  EXPECT_EQ(log_.lines(), (Lines{"info r s: slam: aborted"}));
}

TEST_F(OutputLogTest, WhatIsNoTextIsNotWritten) {
  output_.add(std::string("\x1b[31mred\0\n", 10), now_);
  EXPECT_EQ(log_.lines(), (Lines{"info r s: slam: ?[31mred?"}));
}

TEST_F(OutputLogTest, ALineIsCutAndTheNextOneIsNot) {
  const std::string most(OutputLog::kLineBytes, 'x');
  output_.add(most + "\n", now_);
  output_.add(most, now_);
  output_.add("y", now_);
  output_.add("zz\nshort\n", now_);
  EXPECT_EQ(log_.lines(), (Lines{"info r s: slam: " + most, "info r s: slam: " + most + "...",
                                 "info r s: slam: short"}));
}

TEST_F(OutputLogTest, ABurstIsHeardAndThenSoManyASecond) {
  add_lines(OutputLog::kBurst + 7);
  EXPECT_EQ(log_.lines().size(), static_cast<std::size_t>(OutputLog::kBurst));
  now_ += seconds(1);
  add_lines(OutputLog::kPerSecond + 5);
  EXPECT_EQ(log_.lines("slam: line").size(),
            static_cast<std::size_t>(OutputLog::kBurst + OutputLog::kPerSecond));
  EXPECT_EQ(log_.lines("(7 lines left out)").size(), 1U);
  output_.end(now_);
  EXPECT_EQ(log_.lines("(5 lines left out)").size(), 1U);
  now_ += seconds(3600);
  add_lines(2 * OutputLog::kBurst);
  EXPECT_EQ(log_.lines("slam: line").size(),
            static_cast<std::size_t>(2 * OutputLog::kBurst + OutputLog::kPerSecond));
}

}  // namespace
}  // namespace orbbuf
