// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_closing.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

TEST(SessionClosing, ReadsWhatItHasWritten) {
  const wire::Stats stats{500, 1, 2, 3, 494, 0, 0};
  for (const bool has_ended : {true, false}) {
    for (const auto& known : {std::optional(stats), std::optional<wire::Stats>()}) {
      const SessionClosing closing{has_ended, known};
      EXPECT_EQ(closing_from_csv(to_csv(closing)), closing);
    }
  }
  EXPECT_EQ(to_csv({true, stats}),
            "state,captured,skipped,failed,dropped,acknowledged\nended,500,1,2,3,494\n");
}

TEST(SessionClosing, RefusesWhatIsNone) {
  const std::string header = "state,captured,skipped,failed,dropped,acknowledged\n";
  for (const char* line : {"", "ended", "over,1,2,3,4,5\n", "ended,1,2,3,4\n", "ended,1,2,3,4,5",
                           "ended,1,2,3,4,5,6\n", "ended,1,2,x,4,5\n", "open,,,,,\n\n",
                           "ended,1,2,3,4,5\nended,1,2,3,4,5\n"}) {
    EXPECT_FALSE(closing_from_csv(header + line)) << line;
  }
  EXPECT_FALSE(closing_from_csv("open,,,,,\n"));
}

}  // namespace
}  // namespace orbbuf
