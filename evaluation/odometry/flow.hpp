// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace orbbuf::evaluation {

/// An image's pyramid, as Lucas and Kanade's method wants it.
using Pyramid = std::vector<cv::Mat>;

Pyramid make_pyramid(const cv::Mat& image);

/// Where a point has gone.
struct Flow {
  cv::Point2f place;
  bool is_found = false;
};

/// Follows points from one image to another (KLT). A point is found if following it back leads to
/// where it was, within half a pixel. `expected`: where the search begins, for each point.
std::vector<Flow> follow(const Pyramid& from, const Pyramid& to,
                         const std::vector<cv::Point2f>& points,
                         const std::vector<cv::Point2f>& expected);

}  // namespace orbbuf::evaluation
