// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/odometry.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "evaluation/odometry/adjust.hpp"
#include "evaluation/odometry/relocate.hpp"
#include "evaluation/odometry/resection.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr int kTracks = 350;
constexpr double kApartPx = 14;
constexpr std::size_t kLeastInliers = 15;
constexpr double kLeastShare = 0.5;         // of the points followed
constexpr double kLeastShareMatched = 0.3;  // of those found by descriptor
constexpr double kOutlierPx = 3;
constexpr double kKeyframeMotion = 0.058;  // of the focal length: points have moved, on average
constexpr double kPointsLeft = 0.75;       // of those at the last keyframe
constexpr double kFirstMapMotion = 0.063;  // the median, until one camera sees depth
constexpr std::size_t kFirstMapPoints = 60;
constexpr double kMotionDegrees = 1.2;  // between rays, for a new point
constexpr double kStereoLeastPx = 2.5;  // disparity, for a new point
constexpr std::size_t kWindow = 8;

Eigen::Vector2d to_eigen(const cv::Point2f& p) { return {p.x, p.y}; }

std::vector<cv::Point2f> pixels_of(const std::vector<Track>& tracks) {
  std::vector<cv::Point2f> pixels;
  pixels.reserve(tracks.size());
  for (const Track& track : tracks) pixels.push_back(track.pixel);
  return pixels;
}

double moved_px(const Track& track) {
  return (to_eigen(track.pixel) - track.seen.back().pixel).norm();
}

}  // namespace

std::optional<Eigen::Isometry3d> Odometry::track(const GrayFrame& frame) {
  if (state_ == State::kLost) return std::nullopt;
  Pyramid pyramid = make_pyramid(frame.left);
  if (tracks_.empty()) {
    begin(frame, std::move(pyramid));
  } else if (state_ == State::kStarting) {
    start_mono(frame, std::move(pyramid));
  } else {
    if (!locate(pyramid, motion_.expected(frame.time_s)) && !locate(pyramid, pose_) &&
        !locate_anywhere(frame)) {
      if (++failures_ >= kPatience) state_ = State::kLost;
      return std::nullopt;
    }
    failures_ = 0;
    last_ = std::move(pyramid);
    last_image_ = frame.left;
    if (wants_keyframe()) add_keyframe(frame);
  }
  if (state_ != State::kTracking) return std::nullopt;
  motion_.moved_to(frame.time_s, pose_);
  return pose_.inverse();
}

void Odometry::begin(const GrayFrame& frame, Pyramid pyramid) {
  last_ = std::move(pyramid);
  last_image_ = frame.left;
  keyframes_.clear();
  tracks_.clear();
  pose_ = Eigen::Isometry3d::Identity();
  add_keyframe(frame);
  if (camera_.is_stereo() && points() >= kFirstMapPoints) state_ = State::kTracking;
}

void Odometry::start_mono(const GrayFrame& frame, Pyramid pyramid) {
  keep(follow(last_, pyramid, pixels_of(tracks_), pixels_of(tracks_)));
  last_ = std::move(pyramid);
  last_image_ = frame.left;
  if (tracks_.size() < 2 * kFirstMapPoints) {
    tracks_.clear();
    begin(frame, make_pyramid(frame.left));
    return;
  }
  if (!make_first_map()) return;
  state_ = State::kTracking;
  add_keyframe(frame);
}

bool Odometry::make_first_map() {
  std::vector<double> motion;
  std::vector<cv::Point2d> from;
  std::vector<cv::Point2d> to;
  for (const Track& track : tracks_) {
    motion.push_back(moved_px(track));
    from.emplace_back(track.seen[0].pixel.x(), track.seen[0].pixel.y());
    to.emplace_back(track.pixel);
  }
  const auto middle = motion.begin() + static_cast<std::ptrdiff_t>(motion.size() / 2);
  std::ranges::nth_element(motion, middle);
  if (*middle < kFirstMapMotion * camera_.fx) return false;
  cv::Mat mask;
  const cv::Mat essential =
      cv::findEssentialMat(from, to, matrix_of(camera_), cv::RANSAC, 0.999, 1.0, mask);
  if (essential.rows != 3) return false;
  cv::Matx33d rotation;
  cv::Vec3d place;
  cv::recoverPose(essential, from, to, matrix_of(camera_), rotation, place, mask);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) pose.linear()(row, column) = rotation(row, column);
    pose.translation()(row) = place[row];
  }
  std::vector<Track> with_points = tracks_;
  std::size_t count = 0;
  for (std::size_t i = 0; i < with_points.size(); ++i) {
    Track& track = with_points[i];
    const auto point = triangulate(camera_, keyframes_[0], track.seen[0].pixel, pose,
                                   to_eigen(track.pixel), kMotionDegrees);
    if (mask.at<std::uint8_t>(static_cast<int>(i)) == 0 || !point) continue;
    track.has_point = true;
    track.point = *point;
    ++count;
  }
  if (count < kFirstMapPoints) return false;
  pose_ = pose;
  tracks_ = std::move(with_points);
  return true;
}

void Odometry::keep(const std::vector<Flow>& flows) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    if (!flows[i].is_found) continue;
    if (kept != i) tracks_[kept] = std::move(tracks_[i]);
    tracks_[kept++].pixel = flows[i].place;
  }
  tracks_.resize(kept);
}

bool Odometry::locate(const Pyramid& pyramid, const Eigen::Isometry3d& expected) {
  std::vector<Track> before = tracks_;
  keep(follow(last_, pyramid, pixels_of(tracks_),
              expected_pixels(camera_, tracks_, pose_, expected)));
  if (!take_pose(kLeastInliers, kLeastShare)) {
    tracks_ = std::move(before);
    return false;
  }
  forget_outliers();
  if (!camera_.is_stereo() || keyframes_.size() > 1) add_points_by_motion();
  return true;
}

bool Odometry::locate_anywhere(const GrayFrame& frame) {
  std::vector<Track> known;
  std::ranges::copy_if(tracks_, std::back_inserter(known), &Track::has_point);
  std::vector<Track> found;
  for (const Match& match : match_anywhere(last_image_, pixels_of(known), frame.left)) {
    found.push_back(known[match.old_index]);
    found.back().pixel = match.place;
  }
  std::swap(tracks_, found);
  if (!take_pose(kLeastInliers, kLeastShareMatched)) {
    tracks_ = std::move(found);
    return false;
  }
  forget_outliers();
  return true;
}

bool Odometry::take_pose(std::size_t least_inliers, double least_share) {
  std::vector<cv::Point3d> places;
  std::vector<cv::Point2d> pixels;
  for (const Track& track : tracks_) {
    if (!track.has_point) continue;
    places.emplace_back(track.point.x(), track.point.y(), track.point.z());
    pixels.emplace_back(track.pixel);
  }
  const auto found = resect(camera_, places, pixels);
  if (!found || found->inliers.size() < least_inliers ||
      static_cast<double>(found->inliers.size()) <
          least_share * static_cast<double>(places.size())) {
    return false;
  }
  pose_ = found->pose;
  return true;
}

void Odometry::forget_outliers() {
  std::erase_if(tracks_, [this](const Track& track) {
    if (!track.has_point) return false;
    const auto expected = project(camera_, pose_, track.point);
    return !expected || (*expected - to_eigen(track.pixel)).norm() > kOutlierPx;
  });
}

void Odometry::add_points_by_motion() {
  for (Track& track : tracks_) {
    if (track.has_point) continue;
    const Observation& first = track.seen.front();
    const auto point = triangulate(camera_, keyframes_[first.keyframe], first.pixel, pose_,
                                   to_eigen(track.pixel), kMotionDegrees);
    if (!point) continue;
    track.point = *point;
    track.has_point = true;
  }
}

std::size_t Odometry::points() const {
  return static_cast<std::size_t>(std::ranges::count_if(tracks_, &Track::has_point));
}

bool Odometry::wants_keyframe() const {
  if (static_cast<double>(points()) < kPointsLeft * static_cast<double>(points_at_keyframe_)) {
    return true;
  }
  double sum = 0;
  for (const Track& track : tracks_) sum += moved_px(track);
  return sum > kKeyframeMotion * camera_.fx * static_cast<double>(tracks_.size());
}

void Odometry::add_keyframe(const GrayFrame& frame) {
  keyframes_.push_back(pose_);
  for (Track& track : tracks_) {
    track.seen.push_back({keyframes_.size() - 1, to_eigen(track.pixel), -1});
  }
  add_corners(frame.left);
  if (camera_.is_stereo()) add_points_by_stereo(frame);
  if (keyframes_.size() > 1) {
    // At first nothing is known well enough to be held.
    adjust(camera_, keyframes_, tracks_, kWindow, keyframes_.size() > kWindow ? 2 : 1);
    pose_ = keyframes_.back();
    forget_outliers();
  }
  points_at_keyframe_ = points();
}

void Odometry::add_corners(const cv::Mat& image) {
  cv::Mat mask(image.size(), CV_8U, cv::Scalar(255));
  for (const Track& track : tracks_) {
    cv::circle(mask, track.pixel, static_cast<int>(kApartPx), 0, cv::FILLED);
  }
  const int room = kTracks - static_cast<int>(tracks_.size());
  for (const cv::Point2f& corner : find_corners(image, room, kApartPx, mask)) {
    Track& track = tracks_.emplace_back();
    track.pixel = corner;
    track.seen.push_back({keyframes_.size() - 1, to_eigen(corner), -1});
  }
}

void Odometry::add_points_by_stereo(const GrayFrame& frame) {
  const auto flows =
      follow(last_, make_pyramid(frame.right), pixels_of(tracks_), pixels_of(tracks_));
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    Track& track = tracks_[i];
    const double disparity = track.pixel.x - flows[i].place.x;
    if (!flows[i].is_found || disparity < 0.3 || std::abs(track.pixel.y - flows[i].place.y) > 1) {
      continue;
    }
    track.seen.back().right_x = flows[i].place.x;
    if (track.has_point || disparity < kStereoLeastPx) continue;
    const double depth = camera_.fx * camera_.baseline_m / disparity;
    track.point =
        pose_.inverse() * Eigen::Vector3d((track.pixel.x - camera_.cx) / camera_.fx * depth,
                                          (track.pixel.y - camera_.cy) / camera_.fy * depth, depth);
    track.has_point = true;
  }
}

}  // namespace orbbuf::evaluation
