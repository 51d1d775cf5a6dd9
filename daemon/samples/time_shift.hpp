// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "common/sample.hpp"

namespace orbbuf {

/// How far an image is moved against the one before it.
struct ImageMotion {
  std::int64_t from_ns = 0;  ///< when the one before was taken
  std::int64_t to_ns = 0;
  double pixels = 0;
};

/// What lies between the clocks of a camera and of an inertial sensor.
struct TimeShift {
  double seconds = 0;  ///< Kalibr's timeshift_cam_imu: the sensor's time is the camera's and this
  double correlation = 0;  ///< of image motion and angular velocity, at that shift: up to 1
};

/// The shift within 0.2 s either way at which both motions go together best: to about a quarter of
/// the time between two frames. Nothing if there is no motion, or if fewer than 20 images have
/// samples all around. Samples of increasing time.
std::optional<TimeShift> find_time_shift(std::span<const ImageMotion> motions,
                                         std::span<const Sample> samples);

}  // namespace orbbuf
