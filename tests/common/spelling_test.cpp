// SPDX-License-Identifier: Apache-2.0
#include "common/spelling.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

const std::set<std::string> kWords = {"buffer.capacity", "buffer.policy", "link.server",
                                      "log.level"};

TEST(Spelling, SlipFindsItsWord) {
  EXPECT_EQ(nearest_word("buffer.capcity", kWords), "buffer.capacity");  // one missing
  EXPECT_EQ(nearest_word("bufffer.policy", kWords), "buffer.policy");    // one too many
  EXPECT_EQ(nearest_word("link.sevrer", kWords), "link.server");         // two swapped
  EXPECT_EQ(nearest_word("lag.level", kWords), "log.level");             // one replaced
  EXPECT_EQ(nearest_word("log.level", kWords), "log.level");
}

TEST(Spelling, FarWordFindsNothing) {
  EXPECT_EQ(nearest_word("camera.exposure", kWords), std::nullopt);
  EXPECT_EQ(nearest_word("", kWords), std::nullopt);
  EXPECT_EQ(nearest_word("log.level", {}), std::nullopt);
}

TEST(Spelling, TwoLettersOfAShortWordAndAQuarterOfALongOneMayDiffer) {
  const std::set<std::string> words = {"abcd", "abcdefghijkl"};
  EXPECT_EQ(nearest_word("abxx", words), "abcd");
  EXPECT_EQ(nearest_word("axxx", words), std::nullopt);
  EXPECT_EQ(nearest_word("abcdefghixxx", words), "abcdefghijkl");
  EXPECT_EQ(nearest_word("abcdefghxxxx", words), std::nullopt);
}

}  // namespace
}  // namespace orbbuf
