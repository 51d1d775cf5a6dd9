// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "daemon/buffer/send_planner.hpp"

namespace orbbuf {
namespace {

double ratio(const SizeModel& model, int quality, int other) {
  return model.share(quality) / model.share(other);
}

TEST(SizeModel, HasTheSizesOfRecordedSequencesBeforeItHasLearnt) {
  const SizeModel model;
  EXPECT_DOUBLE_EQ(model.share(50), 1);
  EXPECT_NEAR(ratio(model, 80, 30), 2.7, 0.3);
  EXPECT_NEAR(ratio(model, 80, 20), 3.5, 0.5);
  EXPECT_NEAR(ratio(model, 80, 50), 1.9, 0.1);
}

TEST(SizeModel, LessQualityIsFewerBytes) {
  const SizeModel model;
  for (int quality = 1; quality < 98; ++quality) {
    EXPECT_LT(model.share(quality), model.share(quality + 1)) << quality;
  }
}

TEST(SizeModel, LearnsFromResultsAndGoesOnToOtherQualities) {
  SizeModel model;
  for (int i = 0; i < 100; ++i) model.learn(40'000, 80, 20'000, 30);
  EXPECT_NEAR(ratio(model, 80, 30), 2, 0.01);
  const double steps = std::log(100.0 / 40) / std::log(50.0 / 30 * 100 / 40);
  EXPECT_NEAR(ratio(model, 80, 50), std::pow(2, steps), 0.01);
}

TEST(SizeModel, OneOddImageChangesLittle) {
  SizeModel model;
  const double before = ratio(model, 80, 20);
  model.learn(40'000, 80, 39'000, 20);
  EXPECT_GT(ratio(model, 80, 20), 0.9 * before);
  model.learn(40'000, 80, 100, 20);
  EXPECT_LT(ratio(model, 80, 20), 1.1 * before);
}

TEST(SizeModel, ResultsOfNearlyTheSameQualitySayNothing) {
  SizeModel model;
  const double before = ratio(model, 80, 20);
  for (int i = 0; i < 100; ++i) model.learn(40'000, 80, 20'000, 79);
  model.learn(0, 80, 0, 20);
  EXPECT_DOUBLE_EQ(ratio(model, 80, 20), before);
}

}  // namespace
}  // namespace orbbuf
