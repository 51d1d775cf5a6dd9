// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

namespace orbbuf::evaluation {

/// Corners of the image, strongest first, at least `apart_px` from each other and not where `mask`
/// (may be empty) is 0.
std::vector<cv::Point2f> find_corners(const cv::Mat& image, int count, double apart_px,
                                      const cv::Mat& mask);

/// A place in the old image and the same in the new one.
struct Match {
  std::size_t old_index = 0;
  cv::Point2f place;
};

/// Finds the `old_points` of one image among the corners of another by their ORB descriptors, not
/// knowing where to look: the camera may have turned, come up to 1.7 times nearer, and not tilted.
/// About 15 ms.
std::vector<Match> match_anywhere(const cv::Mat& old_image,
                                  const std::vector<cv::Point2f>& old_points,
                                  const cv::Mat& new_image);

}  // namespace orbbuf::evaluation
