// SPDX-License-Identifier: Apache-2.0
// The bench of power cuts, short; ./dev bench powercut runs it at length.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "testing/process.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/e2e/programs.hpp"

namespace orbbuf::test {
namespace {

void expect_nothing_lost_by_five_cuts(const std::vector<std::string>& options) {
  const TemporaryFolder folder;
  std::vector<std::string> command = {
      kOrbbufPowercut, "--server", kOrbbufServer, "--work", (folder / "work").string(),
      "--cuts",        "5"};
  command.insert(command.end(), options.begin(), options.end());
  const Finished cuts = run(command, std::chrono::seconds(280));  // ctest's limit is 300
  if (cuts.status == 77) GTEST_SKIP() << cuts.output;
  EXPECT_EQ(cuts.status, 0) << cuts.output;
  for (const char* line : {"RESULT powercut.cuts 5\n", "RESULT powercut.acknowledged_lost 0\n",
                           "RESULT powercut.named_but_bad 0\n", "RESULT powercut.repeated 0\n",
                           "RESULT powercut.unexplained 0\n"}) {
    EXPECT_NE(cuts.output.find(line), std::string::npos) << line << cuts.output;
  }
}

TEST(PowerCut, FiveCutsLoseNothingThatWasAcknowledged) { expect_nothing_lost_by_five_cuts({}); }

TEST(PowerCut, NorWithARecordingThatStaysWhole) { expect_nothing_lost_by_five_cuts({"--mcap"}); }

}  // namespace
}  // namespace orbbuf::test
