// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "common/jpeg.hpp"

namespace orbbuf::sim {

/// One image as the independent yardstick sees it: twice the features of the daemon's, at full
/// resolution, matched by OpenCV and kept only where one rigid motion of the camera explains them.
/// It shares neither image, nor features, nor matching code with M.
class EpipolarView {
 public:
  explicit EpipolarView(const GrayImage& image);

  /// Inliers of cv::findFundamentalMat (RANSAC, 1 px, 0.99; OpenCV seeds it with a constant) among
  /// the matches that pass the ratio test at 0.8. About 10 ms.
  int inliers(const EpipolarView& other) const;

 private:
  std::vector<cv::Point2f> points_;
  cv::Mat descriptors_;
};

}  // namespace orbbuf::sim
