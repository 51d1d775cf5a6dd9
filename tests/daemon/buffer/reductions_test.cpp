// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/reductions.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>

namespace orbbuf {
namespace {

class ReductionsTest : public testing::Test {
 protected:
  static FramePtr frame(Sequence sequence, int quality = 80) {
    EncodedFrame frame;
    frame.sequence = sequence;
    frame.quality = static_cast<std::uint8_t>(quality);
    return std::make_shared<const EncodedFrame>(std::move(frame));
  }
  void want(const Reductions::Jobs& jobs) {
    reductions_.want(jobs, [](int one, int other) { return std::abs(one - other) < 5; });
  }
  /// Of the job that comes next; 0 if there is none.
  int next_quality() {
    job_ = reductions_.next();
    return job_ ? job_->quality : 0;
  }

  Reductions reductions_;
  std::optional<Reductions::Job> job_;
  const FramePtr first_ = frame(1);
  const FramePtr second_ = frame(2);
};

TEST_F(ReductionsTest, NothingIsWantedAtFirst) {
  EXPECT_FALSE(reductions_.is_wanting());
  EXPECT_FALSE(reductions_.next());
  EXPECT_FALSE(reductions_.reduced(first_));
}

TEST_F(ReductionsTest, JobsComeInOrderAndEachOnce) {
  want({{first_, 30}, {second_, 40}});
  EXPECT_EQ(next_quality(), 30);
  EXPECT_EQ(next_quality(), 40);
  EXPECT_FALSE(reductions_.is_wanting());
}

TEST_F(ReductionsTest, WhatIsMadeStaysWhileItIsWanted) {
  want({{first_, 30}});
  next_quality();
  const FramePtr made = frame(1, 30);
  reductions_.on_made(*job_, made);
  want({{first_, 32}, {second_, 30}});
  EXPECT_EQ(reductions_.reduced(first_), made);
  EXPECT_EQ(next_quality(), 30);
  EXPECT_EQ(job_->whole, second_);
  want({{second_, 30}});
  EXPECT_FALSE(reductions_.reduced(first_));
}

TEST_F(ReductionsTest, AJobThatIsBegunIsNotBegunAgain) {
  want({{first_, 30}});
  next_quality();
  want({{first_, 31}});
  EXPECT_FALSE(reductions_.is_wanting());
}

TEST_F(ReductionsTest, AnotherQualityIsMadeAnewAndTheOldOneServesUntilThen) {
  want({{first_, 60}});
  next_quality();
  const FramePtr made = frame(1, 60);
  reductions_.on_made(*job_, made);
  want({{first_, 30}});
  EXPECT_EQ(reductions_.reduced(first_), made);
  EXPECT_EQ(next_quality(), 30);
}

TEST_F(ReductionsTest, AResultForAQualityThatIsNotWantedAnyMoreEndsNoOtherJob) {
  want({{first_, 60}});
  next_quality();
  const auto old = *job_;
  want({{first_, 30}});
  reductions_.on_made(old, frame(1, 60));
  EXPECT_TRUE(reductions_.reduced(first_));
  EXPECT_EQ(next_quality(), 30);
}

TEST_F(ReductionsTest, AFrameThatCannotBeMadeSmallerIsNotTriedAgain) {
  want({{first_, 30}});
  next_quality();
  reductions_.on_made(*job_, nullptr);
  EXPECT_TRUE(reductions_.has_failed(first_));
  want({{first_, 20}});
  EXPECT_FALSE(reductions_.is_wanting());
  EXPECT_FALSE(reductions_.has_failed(second_));
}

TEST_F(ReductionsTest, AResultForAFrameThatIsNotWantedAnyMoreIsForgotten) {
  want({{first_, 30}});
  next_quality();
  want({});
  reductions_.on_made(*job_, frame(1, 30));
  EXPECT_FALSE(reductions_.reduced(first_));
}

}  // namespace
}  // namespace orbbuf
