// SPDX-License-Identifier: Apache-2.0
#include "daemon/pipeline.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <future>
#include <semaphore>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/buffer/orb_policy.hpp"
#include "daemon/buffer/simple_policies.hpp"
#include "testing/captured_log.hpp"
#include "testing/scripted_source.hpp"
#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

using test::ScriptedSource;

RawFrame gray_frame(int index) {
  static const std::vector<std::uint8_t> pixels(16 * 8, 128);
  RawFrame frame;
  frame.capture_time_ns = 1000 * index;
  frame.width_px = 16;
  frame.height_px = 8;
  frame.stride_bytes = 16;
  frame.data = pixels;
  return frame;
}

std::unique_ptr<ScriptedSource> gray_frames(int count, bool is_live) {
  auto source = std::make_unique<ScriptedSource>(is_live);
  for (int i = 0; i < count; ++i) source->add(gray_frame(i));
  source->end();
  return source;
}

class PipelineTest : public ::testing::Test {
 protected:
  void start(std::unique_ptr<ScriptedSource> source) {
    pipeline_ = std::make_unique<Pipeline>(
        std::move(source), JpegSettings{}, buffer_,
        Pipeline::Events{[this] {
                           ++changes_;
                           on_changed_();
                         },
                         [this](bool failed) { ended_.set_value(failed); },
                         [this](const FramePtr& frame) { encoded_.push_back(frame->sequence); },
                         [this](std::int64_t total_ns) { steps_.push_back(total_ns); }});
    pipeline_->start();
  }
  bool wait_for_end() { return ended_.get_future().get(); }

  FrameBuffer buffer_{{5}, std::make_unique<DropOldestPolicy>()};
  int changes_ = 0;                // worker only
  std::vector<Sequence> encoded_;  // likewise
  std::vector<std::int64_t> steps_;
  std::function<void()> on_changed_ = [] {};
  std::promise<bool> ended_;
  std::unique_ptr<Pipeline> pipeline_;
};

TEST_F(PipelineTest, FramesReachTheBufferNumberedInOrder) {
  start(gray_frames(5, false));
  EXPECT_FALSE(wait_for_end());
  for (Sequence sequence = 0; sequence < 5; ++sequence) {
    const FramePtr frame = buffer_.take();
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->sequence, sequence);
    EXPECT_EQ(frame->capture_time_ns, 1000 * static_cast<std::int64_t>(sequence));
  }
  EXPECT_FALSE(buffer_.take());
  EXPECT_EQ(changes_, 5);
}

TEST_F(PipelineTest, ImagesOfSeveralSizesAreSentAndSaidOnce) {
  const test::CapturedLog log;
  auto source = std::make_unique<ScriptedSource>(false);
  for (int i = 0; i < 4; ++i) {
    RawFrame frame = gray_frame(i);
    if (i % 2 == 1) frame.height_px = 4;
    source->add(std::move(frame));
  }
  source->end();
  start(std::move(source));
  EXPECT_FALSE(wait_for_end());
  EXPECT_EQ(encoded_.size(), 4U);
  EXPECT_EQ(log.lines("warning frame 1 has 16x4 px, the first one 16x8").size(), 1U);
  EXPECT_EQ(log.lines("warning frame").size(), 1U);
}

TEST_F(PipelineTest, EachStepOfTheSourcesClockIsToldOnce) {
  auto source = std::make_unique<ScriptedSource>();
  for (const std::int64_t total_ns : {0, 0, 5, 5, 3}) {
    RawFrame frame = gray_frame(0);
    frame.clock_step_ns = total_ns;
    source->add(std::move(frame));
  }
  source->end();
  start(std::move(source));
  EXPECT_FALSE(wait_for_end());
  EXPECT_EQ(steps_, (std::vector<std::int64_t>{5, 3}));
}

TEST_F(PipelineTest, SourceThatCanWaitLosesNothingToAFullBuffer) {
  start(gray_frames(50, false));
  Sequence next = 0;
  const auto limit = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (next < 50) {
    ASSERT_LT(std::chrono::steady_clock::now(), limit) << "frame " << next << " did not come";
    if (const FramePtr frame = buffer_.take()) {
      EXPECT_EQ(frame->sequence, next++);
      buffer_.acknowledge(next);
    } else {
      std::this_thread::yield();
    }
  }
  EXPECT_FALSE(wait_for_end());
  EXPECT_EQ(buffer_.stats().acknowledged, 50U);
  EXPECT_EQ(buffer_.stats().dropped, 0U);
}

TEST_F(PipelineTest, LiveSourceNeverWaitsAndEveryFrameIsAccountedFor) {
  start(gray_frames(1000, true));
  EXPECT_FALSE(wait_for_end());
  const wire::Stats stats = buffer_.stats();
  EXPECT_EQ(stats.captured, 1000U);
  EXPECT_EQ(stats.captured, stats.skipped + stats.dropped + stats.waiting);
  EXPECT_EQ(collect_drops(buffer_).size(), stats.skipped + stats.dropped);
  EXPECT_EQ(encoded_.size(), stats.captured - stats.skipped);
}

TEST_F(PipelineTest, FrameThatCannotBeReadIsNamedAndTheRestGoesOn) {
  auto source = std::make_unique<ScriptedSource>();
  for (int i = 0; i < 3; ++i) {
    RawFrame frame = gray_frame(i);
    if (i == 1) frame.defect = "cannot read a.png: truncated";
    source->add(std::move(frame));
  }
  source->end();
  start(std::move(source));
  EXPECT_FALSE(wait_for_end());
  EXPECT_EQ(buffer_.take()->sequence, 0U);
  EXPECT_EQ(buffer_.take()->sequence, 2U);
  EXPECT_EQ(encoded_, (std::vector<Sequence>{0, 2}));
  EXPECT_EQ(buffer_.stats().failed, 1U);
  EXPECT_EQ(collect_drops(buffer_), (std::vector<DropRecord>{{1, 1000, DropReason::kFailed}}));
}

TEST_F(PipelineTest, SourceThatIsGoneEndsTheStreamAsFailed) {
  auto source = std::make_unique<ScriptedSource>();
  for (int i = 0; i < 2; ++i) source->add(gray_frame(i));
  source->end("unplugged");
  start(std::move(source));
  EXPECT_TRUE(wait_for_end());
  EXPECT_EQ(buffer_.stats().captured, 2U);
}

TEST_F(PipelineTest, AnExceptionOnTheWorkerEndsTheStreamAsFailed) {
  on_changed_ = [this] {
    if (changes_ == 2) throw std::runtime_error("no memory");
  };
  start(gray_frames(1000, true));
  EXPECT_TRUE(wait_for_end());
  const wire::Stats stats = buffer_.stats();
  EXPECT_EQ(stats.waiting, 2U);
  EXPECT_EQ(stats.captured, stats.skipped + stats.dropped + stats.failed + stats.waiting);
}

TEST_F(PipelineTest, StopEndsAPipelineThatWaitsForRoom) {
  auto source = gray_frames(1000, false);
  std::promise<void> is_full;
  source->before_frame = [&](int index) {
    if (index == 7)
      is_full.set_value();  // five wait in the buffer, one with the worker, one between
  };
  start(std::move(source));
  is_full.get_future().wait();
  pipeline_->stop();
  EXPECT_FALSE(wait_for_end());
  const wire::Stats stats = buffer_.stats();
  EXPECT_EQ(stats.waiting, 5U);
  EXPECT_EQ(stats.captured, stats.dropped + stats.waiting);
  for (const DropRecord& record : collect_drops(buffer_)) {
    EXPECT_EQ(record.reason, DropReason::kShutdown);
  }
}

/// A pipeline without a sender, whose extractor waits for the source and the source for it.
class SlowExtractionTest : public ::testing::Test {
 protected:
  static constexpr int kFrames = 12;
  static constexpr int kSlow = kFrames - 3;  // extractions: one between any two frames from here on

  void extract() {
    log_ += 'x';
    if (++extractions_ <= kSlow) {
      begun_.release();
      done_.acquire();
    }
  }
  /// On `capture`, with frame index - 1 in the mailbox. The third frame is the first to be
  /// prepared for.
  void before_frame(int index) {
    if (index == 1 || index == 2) pushed_.acquire();
    if (index > 3) done_.release();
    if (index >= 3) begun_.acquire();
    if (index == kFrames - 1) done_.release();
  }

  FrameBuffer buffer_{
      {kFrames},
      std::make_unique<OrbPolicy>([this](const EncodedFrame&, FeatureSet&) { extract(); })};
  std::counting_semaphore<> pushed_{0};
  std::counting_semaphore<> begun_{0};
  std::counting_semaphore<> done_{0};
  int extractions_ = 0;  // worker only
  std::string log_;      // worker only: a frame pushed, an extraction
};

TEST_F(SlowExtractionTest, ACapturedFrameComesBeforeTheNextUnitOfPreparation) {
  auto source = gray_frames(kFrames, true);
  source->before_frame = [this](int index) { before_frame(index); };
  std::promise<void> ended;
  const auto on_changed = [this] {
    log_ += 'p';
    pushed_.release();
  };
  Pipeline pipeline(std::move(source), JpegSettings{}, buffer_,
                    {on_changed, [&](bool) { ended.set_value(); }});
  pipeline.start();
  ended.get_future().wait();
  EXPECT_EQ(log_.substr(0, 20), "pppxpxpxpxpxpxpxpxpx");
  EXPECT_EQ(buffer_.stats().skipped, 0U);
  EXPECT_EQ(buffer_.stats().waiting, static_cast<std::uint64_t>(kFrames));
}

}  // namespace
}  // namespace orbbuf
