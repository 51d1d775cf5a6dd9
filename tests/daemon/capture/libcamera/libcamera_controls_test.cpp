// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/libcamera/libcamera_controls.hpp"

#include <gmock/gmock.h>
#include <libcamera/control_ids.h>
#include <libcamera/controls.h>

#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using libcamera::ControlInfo;
using libcamera::ControlInfoMap;
using testing::ElementsAre;
namespace controls = libcamera::controls;

const ControlInfoMap& offered() {
  static const ControlInfoMap kOffered(
      {{&controls::AnalogueGain, ControlInfo(1.0F, 16.0F, 1.0F)},
       {&controls::ExposureTime, ControlInfo(100, 66666, 20000)},
       {&controls::AeEnable, ControlInfo(false, true, true)},
       {&controls::ColourGains, ControlInfo(0.0F, 32.0F)},
       {&controls::FrameDurationLimits,
        ControlInfo(std::int64_t{20000}, std::int64_t{1000000}, std::int64_t{33333})}},
      controls::controls);
  return kOffered;
}

std::string refusal(const std::string& name, double value) {
  return test::error_of([&] { control_list(offered(), {{name, value}}); });
}

TEST(LibcameraControls, NamesAreInLowerCase) {
  EXPECT_EQ(libcamera_control_name("ExposureTime"), "exposure_time");
  EXPECT_EQ(libcamera_control_name("AeEnable"), "ae_enable");
  EXPECT_EQ(libcamera_control_name("Brightness"), "brightness");
  EXPECT_EQ(libcamera_control_name(""), "");
}

TEST(LibcameraControls, EachIsSetInItsType) {
  const auto list =
      control_list(offered(), {{"ae_enable", 0}, {"analogue_gain", 2.5}, {"exposure_time", 10000}});
  EXPECT_EQ(list.size(), 3U);
  EXPECT_EQ(list.get(controls::AeEnable), false);
  EXPECT_EQ(list.get(controls::AnalogueGain), 2.5F);
  EXPECT_EQ(list.get(controls::ExposureTime), 10000);
}

TEST(LibcameraControls, WhatItDoesNotTakeIsRefusedWithTheRange) {
  EXPECT_EQ(refusal("exposure_time", 99),
            "control exposure_time: must be 100 to 66666, default 20000, got 99");
  EXPECT_EQ(refusal("exposure_time", 100.5),
            "control exposure_time: must be 100 to 66666, default 20000, got 100.5");
  EXPECT_EQ(refusal("analogue_gain", 16.5),
            "control analogue_gain: must be 1 to 16, default 1, got 16.5");
  EXPECT_EQ(refusal("ae_enable", 2), "control ae_enable: must be 0 to 1, default 1, got 2");
}

TEST(LibcameraControls, OneThatIsNotThereIsRefusedWithThoseThatCanBeSet) {
  const auto names = "its controls: ae_enable, analogue_gain, exposure_time";
  EXPECT_EQ(refusal("zoom", 1), std::string("no control zoom; ") + names);
  EXPECT_EQ(refusal("colour_gains", 1), std::string("no control colour_gains; ") + names);
  EXPECT_EQ(test::error_of([] {
              control_list(ControlInfoMap(), {{"zoom", 1}});
            }),
            "no control zoom; its controls: none");
}

TEST(LibcameraControls, APartOfTheSensorIsCapturedWhereThereIsOne) {
  const libcamera::Rectangle sensor(0, 0, 3280, 2464);
  const ControlInfoMap cropping(
      {{&controls::ScalerCrop, ControlInfo(libcamera::Rectangle(), sensor, sensor)}},
      controls::controls);
  auto list = control_list(cropping, {});
  set_crop(list, cropping, {1640, 1232, 1640, 1232});
  EXPECT_EQ(list.get(controls::ScalerCrop), libcamera::Rectangle(1640, 1232, 1640, 1232));
  EXPECT_EQ(test::error_of([&] {
              set_crop(list, cropping, {1640, 1232, 1641, 1232});
            }),
            "cannot crop its sensor to 1640x1232+1641+1232: the sensor is (0, 0)/3280x2464");
  EXPECT_EQ(test::error_of([&] {
              set_crop(list, offered(), {64, 64, 0, 0});
            }),
            "cannot crop its sensor to 64x64+0+0: the camera does not support cropping");
}

TEST(LibcameraControls, TheRateIsTheNearestThatTheCameraHas) {
  const auto rate_of = [](double fps) {
    auto list = control_list(offered(), {});
    const double rate = set_rate(list, offered(), fps);
    const auto limits = list.get(controls::FrameDurationLimits);
    EXPECT_EQ(limits.value()[0], limits.value()[1]);
    EXPECT_EQ(rate, 1e6 / static_cast<double>(limits.value()[0]));
    return rate;
  };
  EXPECT_EQ(rate_of(25), 25);
  EXPECT_EQ(rate_of(90), 50);
  EXPECT_EQ(rate_of(0.1), 1);
  auto list = control_list(offered(), {});
  EXPECT_EQ(set_rate(list, ControlInfoMap(), 25), 0);
  EXPECT_TRUE(list.empty());
}

TEST(LibcameraControls, AreListedByName) {
  EXPECT_THAT(describe_controls(offered()),
              ElementsAre("ae_enable: 0 to 1, default 1", "analogue_gain: 1 to 16, default 1",
                          "exposure_time: 100 to 66666, default 20000"));
}

}  // namespace
}  // namespace orbbuf
