// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_source.hpp"

#include <gmock/gmock.h>
#include <sys/eventfd.h>

#include <deque>
#include <stdexcept>
#include <thread>
#include <vector>

#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;

constexpr double kFps = 1000;  // so that a stall is noticed after little over 1 s

/// What a camera does from being opened until it fails.
struct Script {
  std::string refusal;                ///< not empty: it does not even open
  std::deque<CameraBuffer> buffers;   ///< given in turn
  std::string failure = "unplugged";  ///< afterwards; empty: it stands still
};

class ScriptedStream : public CameraStream {
 public:
  explicit ScriptedStream(Script script) : script_(std::move(script)), event_(::eventfd(1, 0)) {
    if (!script_.refusal.empty()) throw std::runtime_error(script_.refusal);
  }

  int fd() const override { return stands_still() ? -1 : event_.get(); }
  const CameraMode& mode() const override { return mode_; }
  std::string description() const override { return "7 (Eye, attic)"; }

  Result<std::optional<CameraBuffer>> borrow() override {
    if (stands_still()) return std::optional<CameraBuffer>();
    if (script_.buffers.empty()) return Error{script_.failure};
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

Script films(std::deque<CameraBuffer> buffers) { return {"", std::move(buffers)}; }

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

TEST(CameraSource, TellsWhatItFilms) {
  const auto source = source_of({films({})});
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
  auto source = source_of({films({first, buffer(2)})});
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
  auto source = source_of({films({corrupt, cut, buffer(3)})});
  EXPECT_THAT(source.next({})->defect, HasSubstr("calls this image corrupt"));
  EXPECT_THAT(source.next({})->defect, HasSubstr("cut short"));
  EXPECT_EQ(source.next({})->defect, "");
}

TEST(CameraSource, ACameraThatFailsIsOpenedAgainUntilItIsBack) {
  Script refused;
  refused.refusal = "no such camera";
  auto source = source_of({films({buffer(90)}), films({}), refused, films({buffer(1)})});
  const auto before = source.next({});
  const auto after = source.next({});
  ASSERT_TRUE(after);
  EXPECT_GT(after->capture_time_ns, before->capture_time_ns);
}

TEST(CameraSource, ACameraThatStandsStillIsOpenedAgain) {
  Script still = films({buffer(1)});
  still.failure = "";
  auto source = source_of({still, films({buffer(1)})});
  const auto start = std::chrono::steady_clock::now();
  source.next({});
  ASSERT_TRUE(source.next({}));
  const auto waited = std::chrono::steady_clock::now() - start;
  EXPECT_GE(waited, std::chrono::milliseconds(1003));
  EXPECT_LT(waited, std::chrono::seconds(3));
}

TEST(CameraSource, StopEndsTheWaitForACameraThatIsGone) {
  auto source = source_of({films({})});
  std::stop_source stop;
  std::jthread stopper([&stop] { stop.request_stop(); });
  EXPECT_FALSE(source.next(stop.get_token()));
}

}  // namespace
}  // namespace orbbuf
