// SPDX-License-Identifier: Apache-2.0
#include "daemon/reducer.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <semaphore>
#include <utility>
#include <vector>

#include "common/jpeg.hpp"
#include "daemon/buffer/simple_policies.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;

/// An image of stripes, at quality 80; or bytes that are no JPEG.
std::vector<std::uint8_t> image(bool is_jpeg) {
  if (!is_jpeg) return std::vector<std::uint8_t>(10'000, 0x55);
  constexpr int kSidePx = 256;
  std::vector<std::uint8_t> pixels(std::size_t{kSidePx} * kSidePx);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    pixels[i] = static_cast<std::uint8_t>((i * i / 77 + i / kSidePx * 13) % 256);
  }
  return JpegCodec().encode({pixels.data(), kSidePx, kSidePx, kSidePx, 1}, 80, false).value();
}

class ReducerTest : public testing::Test {
 protected:
  /// Frame 0 has been sent before an outage of 20 frames, after which the link is slow.
  void outage(bool is_jpeg) {
    const auto jpeg = image(is_jpeg);
    for (Sequence sequence = 0; sequence <= 20; ++sequence) {
      EncodedFrame frame;
      frame.sequence = sequence;
      frame.capture_time_ns = static_cast<std::int64_t>(sequence) * 40'000'000;
      frame.quality = 80;
      frame.jpeg = jpeg;
      buffer_.on_captured();
      buffer_.push(std::make_shared<const EncodedFrame>(std::move(frame)));
      if (sequence == 0) buffer_.take();
    }
    moment_ = {milliseconds(800), 15 * static_cast<double>(jpeg.size())};
    moment_.is_busy = true;
  }

  FrameBuffer buffer_{{},
                      std::make_unique<DropOldestPolicy>(),
                      std::make_unique<SendPlanner>(
                          PlanSettings{std::chrono::seconds(1), milliseconds(250), 80, 20})};
  std::counting_semaphore<> changes_{0};
  SendMoment moment_;
};

TEST_F(ReducerTest, MakesTheFramesSmallerThatAreSentNext) {
  outage(true);
  Reducer reducer(buffer_, [this] { changes_.release(); });
  FramePtr frame;
  while (!(frame = buffer_.take(moment_))) changes_.acquire();
  EXPECT_LT(frame->quality, 80);
  EXPECT_TRUE(frame->is_reduced());
  EXPECT_TRUE(JpegCodec().decode_gray(frame->jpeg, 1));
}

TEST_F(ReducerTest, WhatIsNoJpegIsSentAsItIs) {
  outage(false);
  Reducer reducer(buffer_, [this] { changes_.release(); });
  FramePtr frame;
  while (!(frame = buffer_.take(moment_))) changes_.acquire();
  EXPECT_FALSE(frame->is_reduced());
  EXPECT_GE(buffer_.report().irreducible, 1U);
}

TEST_F(ReducerTest, EndsWhileItWaits) {
  const Reducer reducer(buffer_, [this] { changes_.release(); });
  EXPECT_FALSE(changes_.try_acquire());
}

}  // namespace
}  // namespace orbbuf
