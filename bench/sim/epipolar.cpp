// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/epipolar.hpp"

#include <cstddef>
#include <map>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>

namespace orbbuf::sim {
namespace {

constexpr int kFeatures = 1000;
constexpr float kRatio = 0.8F;

}  // namespace

EpipolarView::EpipolarView(const GrayImage& image) {
  const cv::Mat pixels(image.height_px, image.width_px, CV_8UC1,
                       const_cast<std::uint8_t*>(image.pixels.data()));
  std::vector<cv::KeyPoint> keypoints;
  cv::ORB::create(kFeatures)->detectAndCompute(pixels, cv::noArray(), keypoints, descriptors_);
  cv::KeyPoint::convert(keypoints, points_);
}

int EpipolarView::inliers(const EpipolarView& other) const {
  if (descriptors_.rows < 2 || other.descriptors_.rows < 2) return 0;
  std::vector<std::vector<cv::DMatch>> candidates;
  cv::BFMatcher(cv::NORM_HAMMING).knnMatch(descriptors_, other.descriptors_, candidates, 2);
  std::map<int, cv::DMatch> best;  // the nearest of those that chose the same point
  for (const auto& pair : candidates) {
    if (!(pair[0].distance < kRatio * pair[1].distance)) continue;
    const auto [entry, is_new] = best.try_emplace(pair[0].trainIdx, pair[0]);
    if (!is_new && pair[0].distance < entry->second.distance) entry->second = pair[0];
  }
  if (best.size() < 8) return 0;
  std::vector<cv::Point2f> from;
  std::vector<cv::Point2f> to;
  for (const auto& [index, match] : best) {
    from.push_back(points_[static_cast<std::size_t>(match.queryIdx)]);
    to.push_back(other.points_[static_cast<std::size_t>(index)]);
  }
  cv::Mat mask;
  cv::findFundamentalMat(from, to, cv::FM_RANSAC, 1.0, 0.99, mask);
  return cv::countNonZero(mask);
}

}  // namespace orbbuf::sim
