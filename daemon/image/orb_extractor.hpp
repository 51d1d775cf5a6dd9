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

/// ORB features (Rublee et al., ICCV 2011) of a frame's JPEG, through OpenCV. Of a stereo frame
/// only the left image is judged: the paper knows mono cameras only, and what either eye sees of
/// the scene overlaps with the last frame about as much. An image of so little contrast that under
/// half of the features are found is searched again, for fainter corners: without any features it
/// would be unlike everything, however well SLAM sees it. Thread-bound. Cost: about 3 ms for
/// 1226x370 on a desktop core, most of it ORB, whatever the size of the image; up to twice that for
/// a pale one.
class OrbExtractor {
 public:
  explicit OrbExtractor(const FeatureSettings& settings);
  ~OrbExtractor();

  /// False in a build without OpenCV's features2d: extract() then finds no features.
  static bool is_built();

  /// Overwrites `features`, whose storage is used again. A JPEG that cannot be decoded has none,
  /// which is logged.
  void extract(const EncodedFrame& frame, FeatureSet& features);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace orbbuf
