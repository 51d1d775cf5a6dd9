// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <map>

#include "bench/chaos/plan.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::chaos {
namespace {

std::vector<std::string> texts(const PlanSettings& settings) {
  std::vector<std::string> all;
  for (const Step& step : make_plan(settings)) all.push_back(step.text());
  return all;
}

TEST(ChaosPlan, TheSeedAndNothingElseMakesThePlan) {
  PlanSettings settings;
  const auto plan = texts(settings);
  EXPECT_EQ(texts(settings), plan);
  settings.seed = 2;
  EXPECT_NE(texts(settings), plan);
}

TEST(ChaosPlan, AllThatBeginsEndsBeforeItBeginsAgain) {
  PlanSettings settings;
  settings.events = 2000;
  bool is_cut = false;
  bool is_reset = false;
  bool is_down = false;
  bool is_paused = false;
  std::map<Action, int> counts;
  double last = 0;
  for (const Step& step : make_plan(settings)) {
    EXPECT_GE(step.at_s, last);
    last = step.at_s;
    ++counts[step.action];
    const Action action = step.action;
    EXPECT_FALSE((action == Action::kCut || action == Action::kReset) && (is_cut || is_reset));
    EXPECT_FALSE((action == Action::kKillServer || action == Action::kEndServer ||
                  action == Action::kPauseServer) &&
                 (is_down || is_paused));
    if (action == Action::kCut || action == Action::kMend) is_cut = action == Action::kCut;
    if (action == Action::kReset || action == Action::kEndReset) {
      is_reset = action == Action::kReset;
    }
    if (action == Action::kKillServer || action == Action::kEndServer) is_down = true;
    if (action == Action::kStartServer) is_down = false;
    if (action == Action::kPauseServer || action == Action::kResumeServer) {
      is_paused = action == Action::kPauseServer;
    }
  }
  EXPECT_FALSE(is_cut || is_reset || is_down || is_paused) << "at the end";
  EXPECT_EQ(counts.size(), 11U) << "every action comes up";
  const int events = counts[Action::kRate] + counts[Action::kCut] + counts[Action::kReset] +
                     counts[Action::kKillServer] + counts[Action::kEndServer] +
                     counts[Action::kPauseServer] + counts[Action::kKillRobot];
  EXPECT_EQ(events, settings.events);
}

TEST(ChaosPlan, RatesAreReadFromBothKindsOfTrace) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "a.json",
                   "[\n {\"duration_ms\": 1000, \"bandwidth_kbps\": 2500, \"latency_ms\": 20},\n"
                   " {\"duration_ms\": 1000, \"bandwidth_kbps\": 0, \"latency_ms\": 20}\n]\n");
  test::write_file(folder / "b.up", "1\n2\n3\n2001\n");
  const std::vector<double> rates = read_rates(folder.path());
  ASSERT_EQ(rates.size(), 5U);
  EXPECT_DOUBLE_EQ(rates[0], 2.5);
  EXPECT_DOUBLE_EQ(rates[2], 0.036);
  EXPECT_DOUBLE_EQ(rates[3], 0);
  EXPECT_TRUE(read_rates(folder / "absent").empty());
}

}  // namespace
}  // namespace orbbuf::chaos
