// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/flow.hpp"

#include <cstddef>
#include <cstdint>
#include <opencv2/video/tracking.hpp>

namespace orbbuf::evaluation {
namespace {

const cv::Size kWindow(17, 17);
constexpr int kLevels = 4;
constexpr double kBackPx = 0.5;

std::vector<std::uint8_t> move_points(const Pyramid& from, const Pyramid& to,
                                      const std::vector<cv::Point2f>& points,
                                      std::vector<cv::Point2f>& moved, int levels) {
  std::vector<std::uint8_t> status;
  std::vector<float> error;
  cv::calcOpticalFlowPyrLK(from, to, points, moved, status, error, kWindow, levels,
                           {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.02},
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  return status;
}

}  // namespace

Pyramid make_pyramid(const cv::Mat& image) {
  Pyramid pyramid;
  cv::buildOpticalFlowPyramid(image, pyramid, kWindow, kLevels);
  return pyramid;
}

std::vector<Flow> follow(const Pyramid& from, const Pyramid& to,
                         const std::vector<cv::Point2f>& points,
                         const std::vector<cv::Point2f>& expected) {
  if (points.empty()) return {};
  std::vector<cv::Point2f> there = expected;
  const auto forth = move_points(from, to, points, there, kLevels);
  std::vector<cv::Point2f> again = points;  // it is there or was no use: one level will do
  const auto back = move_points(to, from, there, again, 1);
  const cv::Rect2f inside(1, 1, static_cast<float>(to[0].cols - 2),
                          static_cast<float>(to[0].rows - 2));
  std::vector<Flow> flows(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    flows[i].place = there[i];
    flows[i].is_found = forth[i] != 0 && back[i] != 0 && inside.contains(there[i]) &&
                        cv::norm(again[i] - points[i]) < kBackPx;
  }
  return flows;
}

}  // namespace orbbuf::evaluation
