// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/image_shift.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "common/jpeg.hpp"

namespace orbbuf {
namespace {

/// A part of a wall of tiles of 16 by 16 pixels, each gray in its own way.
std::vector<std::uint8_t> wall(int x, int y, int width_px = 640) {
  std::vector<std::uint8_t> view;
  for (int row = y; row < y + 480; ++row) {
    for (int column = x; column < x + width_px; ++column) {
      view.push_back(
          static_cast<std::uint8_t>(40 + (column / 16 * 7919 + row / 16 * 104'729) % 177));
    }
  }
  JpegCodec codec;
  auto jpeg =
      codec.encode({view.data(), width_px, 480, static_cast<std::size_t>(width_px), 1}, 90, false);
  EXPECT_TRUE(jpeg);
  return std::move(jpeg).value();
}

TEST(ImageShiftTest, IsHowFarTheViewMoves) {
  ImageShift shift;
  EXPECT_FALSE(shift.add(wall(100, 100), 640));
  const auto still = shift.add(wall(100, 100), 640);
  const auto moved = shift.add(wall(112, 116), 640);
  ASSERT_TRUE(still && moved);
  EXPECT_NEAR(*still, 0, 0.1);
  EXPECT_NEAR(*moved, 5, 0.5) << "of a quarter of the size";
}

TEST(ImageShiftTest, ThereIsNoneOfAnotherSizeOrNoImage) {
  ImageShift shift;
  EXPECT_FALSE(shift.add(wall(100, 100), 640));
  EXPECT_FALSE(shift.add(wall(100, 100, 600), 600));
  EXPECT_FALSE(shift.add({}, 640));
  EXPECT_FALSE(shift.add(wall(100, 100, 600), 600)) << "not against the one before the bad one";
}

}  // namespace
}  // namespace orbbuf
