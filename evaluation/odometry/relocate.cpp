// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/relocate.hpp"

#include <algorithm>
#include <cstdint>
#include <map>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

namespace orbbuf::evaluation {
namespace {

constexpr int kPixelsPerCorner = 340;
constexpr double kApartPx = 7;
constexpr float kRatio = 0.85F;
constexpr float kFarthestBits = 64;
constexpr float kOctave = 1.3F;
constexpr int kOctaves = 3;
constexpr int kNearest = 4;

struct Described {
  std::vector<cv::KeyPoint> points;  ///< class_id: index of the point
  cv::Mat descriptors;
};

Described describe(const cv::Mat& image, const std::vector<cv::Point2f>& points, int octaves) {
  Described described;
  for (int octave = 0; octave < octaves; ++octave) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      described.points.emplace_back(points[i], 31.0F, 0.0F, 0.0F, octave, static_cast<int>(i));
    }
  }
  const auto orb = cv::ORB::create(500, kOctave, kOctaves, 19);
  orb->compute(image, described.points, described.descriptors);
  return described;
}

/// The nearest, if what is at another place is clearly farther.
const cv::DMatch* clear_best(const std::vector<cv::DMatch>& nearest, const Described& in) {
  if (nearest.empty() || nearest[0].distance > kFarthestBits) return nullptr;
  const auto place = [&](const cv::DMatch& match) {
    return in.points[static_cast<std::size_t>(match.trainIdx)].class_id;
  };
  for (const cv::DMatch& other : nearest) {
    if (place(other) == place(nearest[0])) continue;
    return nearest[0].distance < kRatio * other.distance ? &nearest[0] : nullptr;
  }
  return &nearest[0];
}

}  // namespace

std::vector<cv::Point2f> find_corners(const cv::Mat& image, int count, double apart_px,
                                      const cv::Mat& mask) {
  std::vector<cv::Point2f> corners;
  if (count <= 0) return corners;
  cv::goodFeaturesToTrack(image, corners, count, 0.005, apart_px, mask, 3);
  return corners;
}

std::vector<Match> match_anywhere(const cv::Mat& old_image,
                                  const std::vector<cv::Point2f>& old_points,
                                  const cv::Mat& new_image) {
  const std::vector<cv::Point2f> corners =
      find_corners(new_image, static_cast<int>(new_image.total()) / kPixelsPerCorner, kApartPx, {});
  if (old_points.empty() || corners.empty()) return {};
  const Described from = describe(old_image, old_points, 1);
  const Described to = describe(new_image, corners, kOctaves);
  if (from.descriptors.empty() || to.descriptors.empty()) return {};
  std::vector<std::vector<cv::DMatch>> nearest;
  cv::BFMatcher(cv::NORM_HAMMING).knnMatch(from.descriptors, to.descriptors, nearest, kNearest);
  std::map<int, const cv::DMatch*> by_corner;  // each belongs to one old point
  for (const auto& candidates : nearest) {
    const cv::DMatch* best = clear_best(candidates, to);
    if (!best) continue;
    auto& taken = by_corner[to.points[static_cast<std::size_t>(best->trainIdx)].class_id];
    if (!taken || best->distance < taken->distance) taken = best;
  }
  std::vector<Match> matches;
  matches.reserve(by_corner.size());
  for (const auto& [corner, match] : by_corner) {
    const auto& old = from.points[static_cast<std::size_t>(match->queryIdx)];
    matches.push_back(
        {static_cast<std::size_t>(old.class_id), corners[static_cast<std::size_t>(corner)]});
  }
  return matches;
}

}  // namespace orbbuf::evaluation
