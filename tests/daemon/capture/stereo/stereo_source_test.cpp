// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stereo/stereo_source.hpp"

#include <gmock/gmock.h>

#include <stdexcept>
#include <utility>

#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

/// What the test films with, from its own thread.
class Film {
 public:
  void add(std::int64_t time_ms) {
    RawFrame frame;
    frame.monotonic_ns = time_ms * 1'000'000;
    frame.capture_time_ns = frame.monotonic_ns + 5;
    const std::lock_guard lock(mutex_);
    frames_.push_back(std::move(frame));
    changed_.notify_all();
  }
  void end(std::string failure = {}) {
    const std::lock_guard lock(mutex_);
    has_ended_ = true;
    failure_ = std::move(failure);
    changed_.notify_all();
  }
  std::optional<RawFrame> take(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, stop, [this] { return !frames_.empty() || has_ended_; });
    if (stop.stop_requested()) return std::nullopt;
    if (frames_.empty() && !failure_.empty()) throw std::runtime_error(failure_);
    if (frames_.empty()) return std::nullopt;
    auto frame = std::move(frames_.front());
    frames_.pop_front();
    return frame;
  }

 private:
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<RawFrame> frames_;
  bool has_ended_ = false;
  std::string failure_;
};

class FilmSource : public FrameSource {
 public:
  FilmSource(Film& film, std::string name) : film_(film), name_(std::move(name)) {}

  std::optional<RawFrame> next(std::stop_token stop) override { return film_.take(stop); }
  bool is_live() const override { return true; }
  std::string description() const override { return name_; }

 private:
  Film& film_;
  std::string name_;
};

class StereoSourceTest : public testing::Test {
 protected:
  Film left_;
  Film right_;
  StereoSource source_{std::make_unique<FilmSource>(left_, "camera a"),
                       std::make_unique<FilmSource>(right_, "camera b"), milliseconds(20)};
};

TEST_F(StereoSourceTest, APairIsOneFrameUnderTheLeftImagesTime) {
  EXPECT_TRUE(source_.is_live());
  EXPECT_EQ(source_.description(), "stereo: left camera a; right camera b; up to 20 ms apart");
  for (std::int64_t i = 0; i < 100; ++i) {
    right_.add(40 * i + 3);
    left_.add(40 * i);
    const auto frame = source_.next({});
    ASSERT_TRUE(frame && frame->right);
    EXPECT_EQ(frame->capture_time_ns, 40'000'000 * i + 5);
    EXPECT_EQ(frame->right->capture_time_ns, 40'000'000 * i + 3'000'005);
  }
}

TEST_F(StereoSourceTest, OneWithoutTheOtherIsNoFrame) {
  left_.add(0);
  left_.add(40);
  right_.add(38);
  EXPECT_EQ(source_.next({})->capture_time_ns, 40'000'005);
}

TEST_F(StereoSourceTest, ItEndsWhenBothHaveAfterWhatTheyFilmed) {
  left_.add(0);
  left_.end();
  right_.add(0);
  right_.end();
  EXPECT_TRUE(source_.next({}));
  EXPECT_FALSE(source_.next({}));
}

TEST_F(StereoSourceTest, ACameraThatIsGoneForGoodIsTheSourcesFailure) {
  right_.end("camera b burnt");
  EXPECT_THAT(test::error_of([&] { source_.next({}); }), HasSubstr("camera b burnt"));
}

TEST_F(StereoSourceTest, AStopEndsItThoughNothingComes) {
  std::stop_source stop;
  std::jthread stopper([&] { stop.request_stop(); });
  EXPECT_FALSE(source_.next(stop.get_token()));
}

}  // namespace
}  // namespace orbbuf
