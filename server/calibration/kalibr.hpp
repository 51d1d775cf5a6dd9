// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

#include "server/calibration/calibration.hpp"

namespace orbbuf {

/// Reads Kalibr's camchain.yaml or camchain-imucam.yaml
/// (github.com/ethz-asl/kalibr/wiki/yaml-formats): one camera or two, `pinhole` with `radtan`,
/// `equidistant`, `fov` or no distortion. Behind it may be imu.yaml of each sensor, below its name.
/// The error names the key.
Result<Calibration> parse_kalibr(std::string_view text);

}  // namespace orbbuf
