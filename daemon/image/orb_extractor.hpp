// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "common/frame.hpp"
#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// `[features]` of orbbufd.toml.
struct FeatureSettings {
  int count = 500;  ///< features kept per frame, the strongest
  int levels = 3;   ///< pyramid levels, each 1.4 times smaller than the last
  /// The image is reduced by 2, 4 or 8 each way, within the JPEG decoder, until no more are left:
  /// half size for 640x480 and 1241x376, a quarter for 1280x1024 and 1920x1080.
  int pixels = 131'072;
};

/// ORB features (Rublee et al., ICCV 2011) of a frame's JPEG, through OpenCV; of a stereo frame, of
/// the left image only. If an image has so little contrast that under half of the features are
/// found, it is searched again for weaker corners: M of an image without features is 0, although
/// SLAM may track it. Thread-bound. Cost: about 3 ms for 1226x370 on a desktop core, most of it
/// ORB, and about the same for other sizes; up to twice that for an image of little contrast.
class OrbExtractor {
 public:
  explicit OrbExtractor(const FeatureSettings& settings);
  ~OrbExtractor();

  /// False in a build without OpenCV's features2d: extract() then finds no features.
  static bool is_built();

  /// Overwrites `features`, and keeps their storage. If the JPEG cannot be decoded, logs that and
  /// finds none.
  void extract(const EncodedFrame& frame, FeatureSet& features);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace orbbuf
