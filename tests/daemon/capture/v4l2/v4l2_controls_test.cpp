// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/v4l2/v4l2_controls.hpp"

#include <gmock/gmock.h>

namespace orbbuf {
namespace {

TEST(V4l2Controls, NamesAreThoseOfV4l2Ctl) {
  EXPECT_EQ(control_name("Brightness"), "brightness");
  EXPECT_EQ(control_name("Exposure, Auto"), "exposure_auto");
  EXPECT_EQ(control_name("White Balance Temperature, Auto"), "white_balance_temperature_auto");
  EXPECT_EQ(control_name("Exposure (Absolute)"), "exposure_absolute");
  EXPECT_EQ(control_name("  64 Bits--Integer  "), "64_bits_integer");
  EXPECT_EQ(control_name(""), "");
}

TEST(V4l2Controls, ANumberOutOfTheRangeIsRefusedWithTheRange) {
  CameraControl gain;
  gain.name = "gain";
  gain.min = -8;
  gain.max = 64;
  gain.step = 2;
  gain.fallback = 16;
  EXPECT_EQ(why_refused(gain, -8), "");
  EXPECT_EQ(why_refused(gain, 64), "");
  EXPECT_EQ(why_refused(gain, 65),
            "control gain: must be -8 to 64 in steps of 2 (default 16), got 65");
  EXPECT_EQ(why_refused(gain, -9),
            "control gain: must be -8 to 64 in steps of 2 (default 16), got -9");
  EXPECT_EQ(why_refused(gain, 2.5),
            "control gain: must be -8 to 64 in steps of 2 (default 16), got 2.5");
}

TEST(V4l2Controls, WhatIsNotInTheMenuIsRefusedWithTheMenu) {
  CameraControl exposure;
  exposure.name = "auto_exposure";
  exposure.max = 3;
  exposure.menu = {"1 Manual Mode", "3 Aperture Priority Mode"};
  EXPECT_EQ(why_refused(exposure, 1), "");
  EXPECT_EQ(why_refused(exposure, 3), "");
  EXPECT_EQ(why_refused(exposure, 2),
            "control auto_exposure: must be one of 1 Manual Mode, 3 Aperture Priority Mode, got 2");
}

TEST(V4l2Controls, AutomaticsAreSwitchedBeforeTheirNumbersAreSet) {
  std::vector<CameraControl> controls(4);
  controls[0].name = "gain";
  controls[1].name = "gain_automatic";
  controls[1].is_switch = true;
  controls[2].name = "auto_exposure";
  controls[2].is_switch = true;
  controls[3].name = "brightness";
  const CameraControls values = {{"brightness", 5}, {"gain", 100}, {"gain_automatic", 0}};
  EXPECT_THAT(setting_order(controls, values),
              testing::ElementsAre("gain_automatic", "brightness", "gain"));
}

}  // namespace
}  // namespace orbbuf
