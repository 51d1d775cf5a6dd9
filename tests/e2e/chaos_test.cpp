// SPDX-License-Identifier: Apache-2.0
// The bench of chaos, short; ./dev bench chaos runs it at length.
#include <gtest/gtest.h>

#include "testing/process.hpp"
#include "testing/source_folder.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/e2e/programs.hpp"

namespace orbbuf::test {
namespace {

class ChaosTest : public ::testing::TestWithParam<int> {};

TEST_P(ChaosTest, FortyEventsLoseNothingAndRepeatNothing) {
  const TemporaryFolder folder;
  std::vector<std::string> command = {kOrbbufChaos,
                                      "--robot",
                                      kOrbbufd,
                                      "--server",
                                      kOrbbufServer,
                                      "--work",
                                      (folder / "work").string(),
                                      "--traces",
                                      kSourceFolder + std::string("/../shared/data/traces"),
                                      "--events",
                                      "40",
                                      "--longest-outage",
                                      "3",
                                      "--seed",
                                      "4"};
  if (GetParam() == 2) command.insert(command.end(), {"--two-links", "--tls"});
  const Finished chaos = run(command, std::chrono::seconds(280));  // ctest's limit is 300
  if (chaos.status == 77) GTEST_SKIP() << chaos.output;
  EXPECT_EQ(chaos.status, 0) << chaos.output;
  for (const char* line : {"RESULT chaos.events 40\n", "RESULT chaos.lost 0\n",
                           "RESULT chaos.repeated 0\n", "RESULT chaos.unexplained 0\n"}) {
    EXPECT_NE(chaos.output.find(line), std::string::npos) << line << chaos.output;
  }
}

INSTANTIATE_TEST_SUITE_P(Links, ChaosTest, ::testing::Values(1, 2), [](const auto& links) {
  return links.param == 2 ? "TwoUnderTls" : "One";
});

}  // namespace
}  // namespace orbbuf::test
