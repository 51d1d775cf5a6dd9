// SPDX-License-Identifier: Apache-2.0
// The bench of chaos, short; ./dev bench chaos runs it at length.
#include <gtest/gtest.h>

#include "testing/process.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::test {
namespace {

TEST(Chaos, FortyEventsLoseNothingAndRepeatNothing) {
  const TemporaryFolder folder;
  const Finished chaos =
      run({ORBBUF_CHAOS, "--robot", ORBBUFD, "--server", ORBBUF_SERVER, "--work",
           (folder / "work").string(), "--traces", ORBBUF_SOURCE_DIR "/../shared/data/traces",
           "--events", "40", "--longest-outage", "3", "--seed", "4"},
          std::chrono::seconds(280));  // ctest's limit is 300
  if (chaos.status == 77) GTEST_SKIP() << chaos.output;
  EXPECT_EQ(chaos.status, 0) << chaos.output;
  for (const char* line : {"RESULT chaos.events 40\n", "RESULT chaos.lost 0\n",
                           "RESULT chaos.repeated 0\n", "RESULT chaos.unexplained 0\n"}) {
    EXPECT_NE(chaos.output.find(line), std::string::npos) << line << chaos.output;
  }
}

}  // namespace
}  // namespace orbbuf::test
