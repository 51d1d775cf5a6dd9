// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "common/calibration/calibration.hpp"

namespace orbbuf {

/// Reads Kalibr's camchain.yaml or camchain-imucam.yaml
/// (github.com/ethz-asl/kalibr/wiki/yaml-formats), or what OpenVINS makes of it: one camera or two,
/// `pinhole` with `radtan`, `equidistant`, `fov` or no distortion; another model is set in
/// Calibration::unread. `T_imu_cam` may stand for `T_cam_imu`, and both cameras' for `T_cn_cnm1`.
/// Behind it may be the noise of each sensor, below its name, each above 0. The first line may be
/// `%YAML:1.0` or `---`. The error names the key.
Result<Calibration> parse_kalibr(std::string_view text);

/// The same document without its comments, in the one form that OpenCV's cv::FileStorage (OpenVINS,
/// VINS-Fusion) and other YAML parsers (Kalibr) all read: each list on one line, the rows of a
/// matrix further in than its key. Numbers keep their digits.
Result<std::string> rewrite_kalibr(std::string_view chain);

/// The same with a sensor of that name below it, from its imu.yaml in the form that Kalibr reads,
/// or the one that it and OpenVINS write, with a name of its own.
Result<std::string> add_imu(std::string_view chain, const std::string& name,
                            std::string_view imu_yaml);

}  // namespace orbbuf
