// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/trajectory.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace orbbuf::evaluation {
namespace {

constexpr double kSameTimeS = 1e-3;
constexpr double kRpeOverS = 1;

struct Pair {
  StampedPose estimate;
  StampedPose truth;
};

std::vector<Pair> pair_up(const Trajectory& estimate, const Trajectory& truth) {
  std::vector<Pair> pairs;
  for (const StampedPose& pose : estimate) {
    if (const StampedPose* match = pose_at(truth, pose.time_s)) pairs.push_back({pose, *match});
  }
  return pairs;
}

/// Over stretches of a second, or a little more where frames are missing.
void add_rpe(const std::vector<Pair>& pairs, TrajectoryError& error) {
  double sum_m = 0;
  double sum_deg = 0;
  std::size_t count = 0;
  for (std::size_t i = 0, j = 0; i < pairs.size(); ++i) {
    while (j < pairs.size() &&
           pairs[j].truth.time_s < pairs[i].truth.time_s + kRpeOverS - kSameTimeS) {
      ++j;
    }
    if (j == pairs.size()) break;
    Eigen::Isometry3d moved = pairs[i].estimate.pose.inverse() * pairs[j].estimate.pose;
    moved.translation() *= error.scale;
    const Eigen::Isometry3d really = pairs[i].truth.pose.inverse() * pairs[j].truth.pose;
    const Eigen::Isometry3d wrong = really.inverse() * moved;
    sum_m += wrong.translation().squaredNorm();
    const double angle = Eigen::AngleAxisd(wrong.rotation()).angle() * 180 / std::numbers::pi;
    sum_deg += angle * angle;
    ++count;
  }
  if (count == 0) return;
  error.rpe_m = std::sqrt(sum_m / static_cast<double>(count));
  error.rpe_deg = std::sqrt(sum_deg / static_cast<double>(count));
}

}  // namespace

Trajectory read_trajectory(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  Trajectory trajectory;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream fields(line);
    StampedPose stamped;
    Eigen::Vector3d place;
    Eigen::Quaterniond turn;
    if (!(fields >> stamped.time_s >> place.x() >> place.y() >> place.z() >> turn.x() >> turn.y() >>
          turn.z() >> turn.w())) {
      throw std::runtime_error(fmt::format("{}:{}: not eight numbers", file.string(), number));
    }
    stamped.pose = Eigen::Translation3d(place) * turn.normalized();
    trajectory.push_back(stamped);
  }
  std::ranges::sort(trajectory, {}, &StampedPose::time_s);
  return trajectory;
}

void write_trajectory(const std::filesystem::path& file, const Trajectory& trajectory) {
  std::ofstream out(file);
  for (const StampedPose& stamped : trajectory) {
    const Eigen::Vector3d place = stamped.pose.translation();
    const Eigen::Quaterniond turn(stamped.pose.rotation());
    out << fmt::format("{:.6f} {:.6f} {:.6f} {:.6f} {:.9f} {:.9f} {:.9f} {:.9f}\n", stamped.time_s,
                       place.x(), place.y(), place.z(), turn.x(), turn.y(), turn.z(), turn.w());
  }
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

const StampedPose* pose_at(const Trajectory& trajectory, double time_s) {
  const auto pose =
      std::ranges::lower_bound(trajectory, time_s - kSameTimeS, {}, &StampedPose::time_s);
  return pose != trajectory.end() && pose->time_s <= time_s + kSameTimeS ? &*pose : nullptr;
}

TrajectoryError compare(const Trajectory& estimate, const Trajectory& truth, bool with_scale) {
  const std::vector<Pair> pairs = pair_up(estimate, truth);
  TrajectoryError error;
  error.poses = pairs.size();
  if (pairs.size() < 3) return error;
  const auto count = static_cast<Eigen::Index>(pairs.size());
  Eigen::Matrix3Xd from(3, count);
  Eigen::Matrix3Xd to(3, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    from.col(i) = pairs[static_cast<std::size_t>(i)].estimate.pose.translation();
    to.col(i) = pairs[static_cast<std::size_t>(i)].truth.pose.translation();
    if (i > 0) error.path_m += (to.col(i) - to.col(i - 1)).norm();
  }
  const Eigen::Matrix4d alignment = Eigen::umeyama(from, to, with_scale);
  error.scale = std::cbrt(alignment.topLeftCorner<3, 3>().determinant());
  double sum = 0;
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector4d aligned = alignment * from.col(i).homogeneous();
    sum += (aligned.head<3>() - to.col(i)).squaredNorm();
  }
  error.ate_m = std::sqrt(sum / static_cast<double>(count));
  add_rpe(pairs, error);
  return error;
}

}  // namespace orbbuf::evaluation
