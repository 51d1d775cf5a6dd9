// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/replay_source.hpp"

#include <gmock/gmock.h>

#include <deque>
#include <stdexcept>
#include <thread>

#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using std::chrono::steady_clock;
using test::error_of;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kDay = 86'400'000 * kMs;

/// Frames of these times, at its reader's pace.
class FakeSource : public FrameSource {
 public:
  explicit FakeSource(std::deque<std::int64_t> times_ns) : times_ns_(std::move(times_ns)) {}

  std::optional<RawFrame> next(std::stop_token /*stop*/) override {
    if (times_ns_.empty()) return std::nullopt;
    RawFrame frame;
    frame.capture_time_ns = times_ns_.front();
    frame.defect = "a fake";
    times_ns_.pop_front();
    return frame;
  }
  bool is_live() const override { return false; }
  std::string description() const override { return "fake"; }

 private:
  std::deque<std::int64_t> times_ns_;
};

ReplaySource::Open fake(const std::deque<std::int64_t>& times_ns) {
  return [times_ns] { return std::make_unique<FakeSource>(times_ns); };
}

std::vector<std::int64_t> take(ReplaySource& source, int count) {
  std::vector<std::int64_t> times;
  for (int i = 0; i < count; ++i) {
    const auto frame = source.next({});
    if (!frame) break;
    times.push_back(frame->capture_time_ns);
  }
  return times;
}

TEST(ReplaySource, AtItsReadersPaceItEndsWhereItsSourceEnds) {
  ReplaySource source(fake({5, kDay, 2 * kDay}), {.is_realtime = false});
  EXPECT_FALSE(source.is_live());
  EXPECT_THAT(take(source, 9), ElementsAre(5, kDay, 2 * kDay));
}

TEST(ReplaySource, InRealTimeNoFrameComesBeforeItIsDue) {
  ReplaySource source(fake({1000 * kMs, 1005 * kMs, 1006 * kMs, 1030 * kMs}), {});
  EXPECT_TRUE(source.is_live());
  const auto begin = steady_clock::now();
  for (const auto due_ms : {0, 5, 6, 30}) {
    const auto frame = source.next({});
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->capture_time_ns, (1000 + due_ms) * kMs);
    EXPECT_EQ(frame->defect, "a fake") << "paced like any other";
    EXPECT_GE(steady_clock::now() - begin, std::chrono::milliseconds(due_ms));
  }
  EXPECT_FALSE(source.next({}));
}

TEST(ReplaySource, AStopEndsTheWaitForAFrameFarOff) {
  for (const auto far_ns : {3'600'000 * kMs, INT64_MAX}) {
    ReplaySource source(fake({0, far_ns}), {});
    ASSERT_TRUE(source.next({}));
    std::optional<RawFrame> frame;
    std::jthread capture([&](const std::stop_token& stop) { frame = source.next(stop); });
    capture.request_stop();
    capture.join();  // the test's time-out is the proof
    EXPECT_FALSE(frame);
  }
}

TEST(ReplaySource, AStopBeforeTheWaitIsSeenToo) {
  ReplaySource source(fake({0, INT64_MAX}), {});
  ASSERT_TRUE(source.next({}));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(source.next(stop.get_token()));
}

TEST(ReplaySource, ARepeatGoesOnOneMeanIntervalAfterTheLastFrame) {
  ReplaySource source(fake({100, 110, 140}), {.is_realtime = false, .is_looped = true});
  EXPECT_THAT(take(source, 8), ElementsAre(100, 110, 140, 160, 170, 200, 220, 230));
}

TEST(ReplaySource, ASingleFrameIsRepeatedAtTheNominalInterval) {
  ReplaySource source(fake({7}),
                      {.is_realtime = false, .is_looped = true, .nominal_interval_ns = 10});
  EXPECT_THAT(take(source, 3), ElementsAre(7, 17, 27));
}

TEST(ReplaySource, TimesIncreaseOverARepeatHoweverCloseTheFrames) {
  ReplaySource source(fake({0, 1}), {.is_realtime = false, .is_looped = true});
  EXPECT_THAT(take(source, 5), ElementsAre(0, 1, 2, 3, 4));
}

TEST(ReplaySource, ARepeatInRealTimeIsPacedToo) {
  ReplaySource source(fake({0, 4 * kMs}), {.is_looped = true});
  const auto begin = steady_clock::now();
  EXPECT_THAT(take(source, 4), ElementsAre(0, 4 * kMs, 8 * kMs, 12 * kMs));
  EXPECT_GE(steady_clock::now() - begin, std::chrono::milliseconds(12));
}

TEST(ReplaySource, ASourceThatIsGoneAtTheRepeatIsAnError) {
  bool is_gone = false;
  const auto open = [&]() -> std::unique_ptr<FrameSource> {
    return std::make_unique<FakeSource>(is_gone ? std::deque<std::int64_t>{}
                                                : std::deque<std::int64_t>{1});
  };
  ReplaySource source(open, {.is_realtime = false, .is_looped = true});
  EXPECT_THAT(take(source, 1), ElementsAre(1));
  is_gone = true;
  EXPECT_THAT(error_of([&] { source.next({}); }),
              HasSubstr("cannot loop fake: it has no frames now"));
}

}  // namespace
}  // namespace orbbuf
