// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_source.hpp"

#include <gmock/gmock.h>
#include <sys/eventfd.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include <deque>
#include <stdexcept>
#include <thread>
#include <vector>

#include "testing/captured_log.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using Clock = std::chrono::steady_clock;

constexpr double kFps = 1000;  // so that a stall is noticed after little over 1 s

/// What a camera does from being opened until it fails.
struct Script {
  std::string refusal;   ///< not empty: it does not even open
  bool is_gone = false;  ///< which is why
  int width_px = 2;
  std::deque<CameraBuffer> buffers;       ///< given in turn
  std::string failure = "unplugged";      ///< afterwards; empty: it stands still
  std::chrono::milliseconds interval{0};  ///< from buffer to buffer
};

/// To poll: readable at each interval, or always if there is none.
UniqueFd event_every(std::chrono::milliseconds interval) {
  if (interval == 0ms) return UniqueFd(::eventfd(1, 0));
  const timespec step = {0, static_cast<long>(std::chrono::nanoseconds(interval).count())};
  const itimerspec steps = {step, step};
  UniqueFd timer(::timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK));
  ::timerfd_settime(timer.get(), 0, &steps, nullptr);
  return timer;
}

class ScriptedStream : public CameraStream {
 public:
  explicit ScriptedStream(Script script)
      : script_(std::move(script)), event_(event_every(script_.interval)) {
    mode_.width_px = script_.width_px;
    if (script_.is_gone) throw CameraGone(script_.refusal);
    if (!script_.refusal.empty()) throw std::runtime_error(script_.refusal);
  }

  int fd() const override { return stands_still() ? -1 : event_.get(); }
  const CameraMode& mode() const override { return mode_; }
  std::string description() const override { return "7 (Eye, attic)"; }
  std::string reset_command() const override { return "reset it"; }

  Result<std::optional<CameraBuffer>> borrow() override {
    if (stands_still()) return std::optional<CameraBuffer>();
    if (script_.buffers.empty()) return Error{script_.failure};
    std::uint64_t ticks = 0;
    if (script_.interval > 0ms && ::read(event_.get(), &ticks, sizeof ticks) < 0) {
      return std::optional<CameraBuffer>();
    }
    const CameraBuffer next = script_.buffers.front();
    script_.buffers.pop_front();
    return std::optional(next);
  }

  std::optional<Error> give_back(const CameraBuffer& /*buffer*/) override { return std::nullopt; }

 private:
  bool stands_still() const { return script_.buffers.empty() && script_.failure.empty(); }

  Script script_;
  UniqueFd event_;
  CameraMode mode_{
      .format = CameraFormat::kGrey, .width_px = 2, .height_px = 1, .stride_bytes = 2, .fps = kFps};
};

const std::vector<std::uint8_t> kPixels = {7, 9};

CameraBuffer buffer(std::uint32_t sequence) {
  CameraBuffer buffer;
  buffer.sequence = sequence;
  buffer.stamp_ns = read_clocks().monotonic_ns;
  buffer.data = kPixels;
  return buffer;
}

Script gives(std::deque<CameraBuffer> buffers) {
  Script script;
  script.buffers = std::move(buffers);
  return script;
}

/// A source whose camera follows one script after the other, and then does not open any more.
CameraSource source_of(std::deque<Script> scripts) {
  auto open = [scripts = std::move(scripts)]() mutable -> std::unique_ptr<CameraStream> {
    if (scripts.empty()) throw std::runtime_error("gone for good");
    Script script = std::move(scripts.front());
    scripts.pop_front();
    return std::make_unique<ScriptedStream>(std::move(script));
  };
  return {std::move(open), "7", kFps};
}

TEST(CameraSource, DescribesItsCameraAndMode) {
  const auto source = source_of({gives({})});
  EXPECT_EQ(source.description(), "camera 7 (Eye, attic): GREY 2x1 px, 1000 fps");
  EXPECT_TRUE(source.is_live());
}

TEST(CameraSource, ACameraThatCannotBeOpenedAtTheStartIsAnError) {
  Script refused;
  refused.refusal = "no such camera";
  EXPECT_EQ(test::error_of([&] { source_of({refused}); }), "no such camera");
}

TEST(CameraSource, AFrameIsACopyWithTimesOfItsOwn) {
  auto first = buffer(1);
  first.exposure_ns = 5'000'000;
  auto source = source_of({gives({first, buffer(2)})});
  const auto frame = source.next({});
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->defect, "");
  EXPECT_THAT(frame->data, testing::ElementsAre(7, 9));
  EXPECT_NE(frame->data.data(), kPixels.data());
  EXPECT_EQ(frame->exposure_ns, 5'000'000U);
  EXPECT_GT(source.next({})->capture_time_ns, frame->capture_time_ns);
}

TEST(CameraSource, CorruptAndCutShortIsADefect) {
  auto corrupt = buffer(1);
  corrupt.is_corrupt = true;
  auto cut = buffer(2);
  cut.data = cut.data.first(1);
  auto source = source_of({gives({corrupt, cut, buffer(3)})});
  EXPECT_THAT(source.next({})->defect, HasSubstr("marked the image as corrupt"));
  EXPECT_THAT(source.next({})->defect, HasSubstr("truncated"));
  EXPECT_EQ(source.next({})->defect, "");
}

TEST(CameraSource, ACameraThatFailsIsOpenedAgainUntilItIsBack) {
  Script refused;
  refused.refusal = "no such camera";
  auto source = source_of({gives({buffer(90)}), gives({}), refused, gives({buffer(1)})});
  const auto before = source.next({});
  const auto after = source.next({});
  ASSERT_TRUE(after);
  EXPECT_GT(after->capture_time_ns, before->capture_time_ns);
}

TEST(CameraSource, ACameraThatIsBackInAnotherSizeIsOpenedUntilItHasTheFirst) {
  const test::CapturedLog log;
  Script wide = gives({buffer(1)});
  wide.width_px = 4;
  auto source = source_of({gives({buffer(1)}), wide, wide, gives({buffer(1)})});
  source.next({});
  EXPECT_EQ(source.next({})->width_px, 2);
  EXPECT_THAT(
      log.lines("cannot reopen"),
      testing::ElementsAre("warning camera 7: cannot reopen it: its mode is now GREY 4x1 px, "
                           "1000 fps, not GREY 2x1 px, 1000 fps; retrying"));
}

TEST(CameraSource, WhyItDoesNotOpenIsLoggedOnceUnlessItIsGone) {
  const test::CapturedLog log;
  Script gone;
  gone.refusal = "no such camera";
  gone.is_gone = true;
  Script refused;
  refused.refusal = "not allowed";
  const Script brief = gives({buffer(1)});
  auto source = source_of({brief, gone, refused, refused, brief});
  source.next({});
  source.next({});
  EXPECT_EQ(log.lines("no such camera").size(), 0U);
  EXPECT_EQ(log.lines("warning camera 7: cannot reopen it: not allowed; retrying").size(), 1U);
}

TEST(CameraSource, ACameraThatStandsStillIsOpenedAgain) {
  Script still = gives({buffer(1)});
  still.failure = "";
  auto source = source_of({still, gives({buffer(1)})});
  const auto start = Clock::now();
  source.next({});
  ASSERT_TRUE(source.next({}));
  const auto waited = Clock::now() - start;
  EXPECT_GE(waited, 1003ms);
  EXPECT_LT(waited, 4500ms);  // as long as the first frame is waited for
}

TEST(CameraSource, ACameraThatFailsAfterEachFrameIsOpenedLessAndLessOften) {
  const Script brief = gives({buffer(1)});
  auto source = source_of({brief, brief, brief, brief});
  source.next({});
  const auto start = Clock::now();
  for (int i = 0; i < 3; ++i) source.next({});
  EXPECT_GE(Clock::now() - start, 300ms);  // 0 + 100 + 200
}

TEST(CameraSource, ACameraThatWorkedForAWhileIsOpenedAtOnceAgain) {
  const Script brief = gives({buffer(1)});
  Script lasting = gives({});
  for (std::uint32_t i = 0; i < 22; ++i) lasting.buffers.push_back(buffer(i));
  lasting.interval = 100ms;
  auto source = source_of({brief, brief, brief, brief, brief, lasting, brief});
  for (int i = 0; i < 5 + 22; ++i) source.next({});
  const auto lost = Clock::now();
  ASSERT_TRUE(source.next({}));
  EXPECT_LT(Clock::now() - lost, 1600ms);  // what else would be next
}

TEST(CameraSource, ACameraThatOpensAndSendsNothingIsReportedOnceWithTheCommandThatResetsIt) {
  const test::CapturedLog log;
  const Script mute = gives({});
  const Script brief = gives({buffer(1)});
  auto source = source_of({mute, mute, mute, mute, brief});
  ASSERT_TRUE(source.next({}));
  EXPECT_THAT(
      log.lines("answers but sends nothing"),
      testing::ElementsAre(
          "error camera 7: the camera answers but sends nothing: opened 3 times in a row, no "
          "frame (unplugged); unplug it and plug it in again, or reset its USB port: reset "
          "it; retrying"));
}

TEST(CameraSource, AFrameBetweenOpeningsInVainIsASignOfLife) {
  const test::CapturedLog log;
  const Script mute = gives({});
  const Script brief = gives({buffer(1)});
  auto source = source_of({mute, mute, brief, mute, brief});
  ASSERT_TRUE(source.next({}));
  ASSERT_TRUE(source.next({}));
  EXPECT_THAT(log.lines("answers but sends nothing"), testing::IsEmpty());
}

TEST(DriverError, NoSpaceOnAUsbBusIsNotAFullDisk) {
  EXPECT_THAT(driver_error(ENOSPC), HasSubstr("the USB bus has no bandwidth left"));
  EXPECT_EQ(driver_error(EIO), "Input/output error");
}

TEST(CameraSource, StopEndsTheWaitForACameraThatIsGone) {
  auto source = source_of({gives({})});
  std::stop_source stop;
  std::jthread stopper([&stop] { stop.request_stop(); });
  EXPECT_FALSE(source.next(stop.get_token()));
}

}  // namespace
}  // namespace orbbuf
