// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_closing.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace orbbuf {
namespace {

TEST(SessionClosing, ReadsWhatItHasWritten) {
  constexpr auto kLeast = -std::numeric_limits<std::int64_t>::max();
  const wire::Stats stats{500, 1, 2, 3, 494, 0, 0};
  for (const bool has_ended : {true, false}) {
    for (const auto& known : {std::optional(stats), std::optional<wire::Stats>()}) {
      for (const auto offset : {std::optional<std::int64_t>(), std::optional(kLeast),
                                std::optional<std::int64_t>(0), std::optional(-kLeast)}) {
        const SessionClosing closing{has_ended, known, offset};
        EXPECT_EQ(closing_from_csv(to_csv(closing)), closing) << to_csv(closing);
      }
    }
  }
  EXPECT_EQ(to_csv({true, stats, -5}),
            "state,captured,skipped,failed,dropped,acknowledged,clock_offset_ns\n"
            "ended,500,1,2,3,494,-5\n");
}

TEST(SessionClosing, ReadsWhatOlderServersHaveWritten) {
  const std::string header = "state,captured,skipped,failed,dropped,acknowledged\n";
  EXPECT_EQ(closing_from_csv(header + "open,,,,,\n"), SessionClosing{});
  EXPECT_EQ(closing_from_csv(header + "ended,5,1,2,3,4\n"),
            (SessionClosing{true, wire::Stats{5, 1, 2, 3, 4, 0, 0}}));
}

TEST(SessionClosing, RefusesWhatIsNone) {
  const std::string header = "state,captured,skipped,failed,dropped,acknowledged\n";
  const std::string with_clock =
      "state,captured,skipped,failed,dropped,acknowledged,clock_offset_ns\n";
  for (const char* line : {"open,,,,,\n", "ended,1,2,3,4,5\n", "ended,1,2,3,4,5,x\n",
                           "ended,1,2,3,4,5,--1\n", "ended,1,2,3,4,5,9223372036854775808\n"}) {
    EXPECT_FALSE(closing_from_csv(with_clock + line)) << line;
  }
  for (const char* line : {"", "ended", "over,1,2,3,4,5\n", "ended,1,2,3,4\n", "ended,1,2,3,4,5",
                           "ended,1,2,3,4,5,6\n", "ended,1,2,x,4,5\n", "open,,,,,\n\n",
                           "ended,1,2,3,4,5\nended,1,2,3,4,5\n"}) {
    EXPECT_FALSE(closing_from_csv(header + line)) << line;
  }
  EXPECT_FALSE(closing_from_csv("open,,,,,\n"));
}

}  // namespace
}  // namespace orbbuf
