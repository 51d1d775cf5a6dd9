// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/replay_source.hpp"

#include <gmock/gmock.h>

#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "testing/scripted_source.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using std::chrono::steady_clock;
using test::error_of;
using test::ScriptedSource;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kDay = 86'400'000 * kMs;

ReplaySource::Open scripted(const std::vector<std::int64_t>& times_ns) {
  return [times_ns] {
    auto source = std::make_unique<ScriptedSource>();
    for (const auto time_ns : times_ns) {
      RawFrame frame;
      frame.capture_time_ns = time_ns;
      frame.defect = "of a script";
      source->add(std::move(frame));
    }
    source->end();
    return source;
  };
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
  ReplaySource source(scripted({5, kDay, 2 * kDay}), {.is_realtime = false});
  EXPECT_FALSE(source.is_live());
  EXPECT_THAT(take(source, 9), ElementsAre(5, kDay, 2 * kDay));
}

TEST(ReplaySource, InRealTimeNoFrameComesBeforeItIsDue) {
  ReplaySource source(scripted({1000 * kMs, 1005 * kMs, 1006 * kMs, 1030 * kMs}), {});
  EXPECT_TRUE(source.is_live());
  const auto begin = steady_clock::now();
  for (const auto due_ms : {0, 5, 6, 30}) {
    const auto frame = source.next({});
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->capture_time_ns, (1000 + due_ms) * kMs);
    EXPECT_EQ(frame->defect, "of a script") << "paced like any other";
    EXPECT_GE(steady_clock::now() - begin, std::chrono::milliseconds(due_ms));
  }
  EXPECT_FALSE(source.next({}));
}

TEST(ReplaySource, AStopEndsTheWaitForAFrameFarOff) {
  for (const auto far_ns : {3'600'000 * kMs, INT64_MAX}) {
    ReplaySource source(scripted({0, far_ns}), {});
    ASSERT_TRUE(source.next({}));
    std::optional<RawFrame> frame;
    std::jthread capture([&](const std::stop_token& stop) { frame = source.next(stop); });
    capture.request_stop();
    capture.join();  // the test's time-out is the proof
    EXPECT_FALSE(frame);
  }
}

TEST(ReplaySource, AStopBeforeTheWaitIsSeenToo) {
  ReplaySource source(scripted({0, INT64_MAX}), {});
  ASSERT_TRUE(source.next({}));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(source.next(stop.get_token()));
}

TEST(ReplaySource, ARepeatGoesOnOneMeanIntervalAfterTheLastFrame) {
  ReplaySource source(scripted({100, 110, 140}), {.is_realtime = false, .is_looped = true});
  EXPECT_THAT(take(source, 8), ElementsAre(100, 110, 140, 160, 170, 200, 220, 230));
}

TEST(ReplaySource, ASingleFrameIsRepeatedAtTheNominalInterval) {
  ReplaySource source(scripted({7}),
                      {.is_realtime = false, .is_looped = true, .nominal_interval_ns = 10});
  EXPECT_THAT(take(source, 3), ElementsAre(7, 17, 27));
}

TEST(ReplaySource, TimesIncreaseOverARepeatHoweverCloseTheFrames) {
  ReplaySource source(scripted({0, 1}), {.is_realtime = false, .is_looped = true});
  EXPECT_THAT(take(source, 5), ElementsAre(0, 1, 2, 3, 4));
}

TEST(ReplaySource, ARepeatInRealTimeIsPacedToo) {
  ReplaySource source(scripted({0, 4 * kMs}), {.is_looped = true});
  const auto begin = steady_clock::now();
  EXPECT_THAT(take(source, 4), ElementsAre(0, 4 * kMs, 8 * kMs, 12 * kMs));
  EXPECT_GE(steady_clock::now() - begin, std::chrono::milliseconds(12));
}

TEST(ReplaySource, ThatIsLikeACameraGoesOnFromTheTimeOfDay) {
  const auto now = [] {
    return std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
  };
  ReplaySource source(scripted({7, 4 * kMs}), {.is_looped = true, .is_like_camera = true});
  const auto before = now();
  const auto times = take(source, 4);
  const auto interval = 4 * kMs - 7;
  EXPECT_GE(times.at(0), before);
  EXPECT_LE(times.at(0), now());
  const std::vector<std::int64_t> steps = {times[1] - times[0], times[2] - times[1],
                                           times[3] - times[2]};
  EXPECT_THAT(steps, ElementsAre(interval, interval, interval));
}

TEST(ReplaySource, AtItsReadersPaceNothingIsLikeACamera) {
  ReplaySource source(scripted({5, 6}), {.is_realtime = false, .is_like_camera = true});
  EXPECT_THAT(take(source, 2), ElementsAre(5, 6));
}

/// Tells when it is asked for each frame.
class AskedSource : public FrameSource {
 public:
  explicit AskedSource(std::vector<steady_clock::time_point>& asked) : asked_(asked) {}
  std::optional<RawFrame> next(std::stop_token /*stop*/) override {
    RawFrame frame;
    frame.capture_time_ns = static_cast<std::int64_t>(asked_.size()) * 40 * kMs;
    asked_.push_back(steady_clock::now());
    return frame;
  }
  bool is_live() const override { return false; }
  std::string description() const override { return "asked"; }

 private:
  std::vector<steady_clock::time_point>& asked_;
};

TEST(ReplaySource, ThatIsLikeACameraMakesNoFrameBesideTheWorkOnTheLastOne) {
  std::vector<steady_clock::time_point> asked;
  ReplaySource source([&] { return std::make_unique<AskedSource>(asked); },
                      {.is_like_camera = true, .nominal_interval_ns = 40 * kMs});
  EXPECT_EQ(take(source, 3).size(), 3U);
  EXPECT_GE(asked.at(1) - asked.at(0), std::chrono::milliseconds(20));
  EXPECT_GE(asked.at(2) - asked.at(0), std::chrono::milliseconds(60));
}

TEST(ReplaySource, ASourceThatIsGoneAtTheRepeatIsAnError) {
  bool is_gone = false;
  const auto open = [&] {
    return scripted(is_gone ? std::vector<std::int64_t>{} : std::vector<std::int64_t>{1})();
  };
  ReplaySource source(open, {.is_realtime = false, .is_looped = true});
  EXPECT_THAT(take(source, 1), ElementsAre(1));
  is_gone = true;
  EXPECT_THAT(error_of([&] { source.next({}); }),
              HasSubstr("cannot loop scripted: it has no frames now"));
}

}  // namespace
}  // namespace orbbuf
