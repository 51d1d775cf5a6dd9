// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "common/frame.hpp"
#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// `[features]` of orbbufd.toml: cv::ORB's own parameters.
struct FeatureSettings {
  int count = 500;  ///< features kept per frame, the strongest
  int levels = 3;   ///< pyramid levels, each 1.4 times smaller than the last
  int scale = 2;    ///< the image is reduced by this first, within the JPEG decoder: 1, 2, 4 or 8
};

/// ORB features (Rublee et al., ICCV 2011) of a frame's JPEG, through OpenCV. Thread-bound.
/// Cost: about 3 ms for 1226x370 on a desktop core at scale 2, most of it ORB.
class OrbExtractor {
 public:
  explicit OrbExtractor(const FeatureSettings& settings);
  ~OrbExtractor();

  /// Overwrites `features`, whose storage is used again. A JPEG that cannot be decoded has none,
  /// which is logged.
  void extract(const EncodedFrame& frame, FeatureSet& features);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace orbbuf
