// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/adjust.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace orbbuf::evaluation {
namespace {

constexpr double kHuberPx = 1.5;
constexpr int kSteps = 6;
constexpr double kNearest = 1e-3;  // depths below are behind the camera, as good as

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Matrix63 = Eigen::Matrix<double, 6, 3>;

/// One observation's errors, and how they change with the pose (moved and turned in the camera's
/// axes) and with the point.
struct Terms {
  Eigen::Vector3d error;  ///< x, y, and x in the right image
  Eigen::Matrix<double, 3, 6> by_pose;
  Eigen::Matrix3d by_point;
  double weight = 0;
  double cost = 0;
};

Eigen::Matrix3d cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Terms terms_of(const Camera& camera, const Eigen::Isometry3d& pose, const Eigen::Vector3d& point,
               const Observation& seen) {
  Terms terms;
  const Eigen::Vector3d p = pose * point;
  const double z = std::max(p.z(), kNearest);
  const bool has_right = seen.right_x >= 0;
  terms.error << camera.fx * p.x() / z + camera.cx - seen.pixel.x(),
      camera.fy * p.y() / z + camera.cy - seen.pixel.y(),
      has_right ? camera.fx * (p.x() - camera.baseline_m) / z + camera.cx - seen.right_x : 0;
  Eigen::Matrix3d by_place;
  by_place << camera.fx / z, 0, -camera.fx * p.x() / (z * z),  //
      0, camera.fy / z, -camera.fy * p.y() / (z * z),          //
      camera.fx / z, 0, -camera.fx * (p.x() - camera.baseline_m) / (z * z);
  if (!has_right) by_place.row(2).setZero();
  terms.by_pose.leftCols<3>() = by_place;
  terms.by_pose.rightCols<3>() = -by_place * cross(p);
  terms.by_point = by_place * pose.linear();
  const double size = terms.error.norm();
  terms.weight = size <= kHuberPx ? 1 : kHuberPx / size;
  terms.cost = size <= kHuberPx ? 0.5 * size * size : kHuberPx * (size - 0.5 * kHuberPx);
  return terms;
}

Eigen::Isometry3d moved(const Eigen::Isometry3d& pose, const Vector6& by) {
  const double angle = by.tail<3>().norm();
  Eigen::Isometry3d change = Eigen::Isometry3d::Identity();
  if (angle > 1e-12) change.linear() = Eigen::AngleAxisd(angle, by.tail<3>() / angle).matrix();
  change.translation() = by.head<3>();
  return change * pose;
}

class Problem {
 public:
  Problem(const Camera& camera, Keyframes& keyframes, std::vector<Track>& tracks,
          std::size_t window, std::size_t fixed)
      : camera_(camera), keyframes_(keyframes) {
    first_ = keyframes.size() > window ? keyframes.size() - window : 0;
    first_free_ = std::min(keyframes.size(), first_ + fixed);
    for (Track& track : tracks) {
      const auto views = std::ranges::count_if(
          track.seen, [this](const Observation& seen) { return seen.keyframe >= first_; });
      if (track.has_point && views >= 2) tracks_.push_back(&track);
    }
  }

  void solve() {
    const std::size_t free = keyframes_.size() - first_free_;
    if (free == 0 || tracks_.size() < 10) return;
    double damping = 1e-4;
    double cost = cost_of();
    for (int step = 0; step < kSteps; ++step) {
      const Keyframes poses = keyframes_;
      const std::vector<Eigen::Vector3d> points = points_of();
      take_step(free, damping);
      const double new_cost = cost_of();
      if (new_cost < cost) {
        const bool is_done = cost - new_cost < 1e-4 * cost;
        cost = new_cost;
        damping /= 5;
        if (is_done) break;
      } else {
        keyframes_ = poses;
        for (std::size_t i = 0; i < tracks_.size(); ++i) tracks_[i]->point = points[i];
        damping *= 20;
      }
    }
  }

 private:
  struct PointBlock {
    Eigen::Matrix3d inverse;
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    std::vector<std::pair<Eigen::Index, Matrix63>> coupling;  ///< with free keyframes
  };

  std::vector<Eigen::Vector3d> points_of() const {
    std::vector<Eigen::Vector3d> points;
    points.reserve(tracks_.size());
    for (const Track* track : tracks_) points.push_back(track->point);
    return points;
  }

  double cost_of() const {
    double cost = 0;
    for (const Track* track : tracks_) {
      for (const Observation& seen : track->seen) {
        if (seen.keyframe < first_) continue;
        cost += terms_of(camera_, keyframes_[seen.keyframe], track->point, seen).cost;
      }
    }
    return cost;
  }

  PointBlock add_point(const Track& track, double damping, Eigen::MatrixXd& hessian,
                       Eigen::VectorXd& gradient) const {
    PointBlock block;
    Eigen::Matrix3d own = Eigen::Matrix3d::Zero();
    for (const Observation& seen : track.seen) {
      if (seen.keyframe < first_) continue;
      const Terms terms = terms_of(camera_, keyframes_[seen.keyframe], track.point, seen);
      own += terms.weight * terms.by_point.transpose() * terms.by_point;
      block.gradient += terms.weight * terms.by_point.transpose() * terms.error;
      if (seen.keyframe < first_free_) continue;
      const auto at = static_cast<Eigen::Index>(6 * (seen.keyframe - first_free_));
      hessian.block<6, 6>(at, at) += terms.weight * terms.by_pose.transpose() * terms.by_pose;
      gradient.segment<6>(at) += terms.weight * terms.by_pose.transpose() * terms.error;
      block.coupling.emplace_back(at, terms.weight * terms.by_pose.transpose() * terms.by_point);
    }
    own.diagonal() *= 1 + damping;
    own.diagonal().array() += 1e-9;
    block.inverse = own.inverse();
    return block;
  }

  void take_step(std::size_t free, double damping) {
    const auto size = static_cast<Eigen::Index>(6 * free);
    Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(size);
    std::vector<PointBlock> blocks;
    blocks.reserve(tracks_.size());
    for (const Track* track : tracks_) {
      blocks.push_back(add_point(*track, damping, hessian, gradient));
    }
    hessian.diagonal() *= 1 + damping;
    hessian.diagonal().array() += 1e-9;
    for (const PointBlock& block : blocks) {
      for (const auto& [row, left] : block.coupling) {
        const Matrix63 eliminated = left * block.inverse;
        gradient.segment<6>(row) -= eliminated * block.gradient;
        for (const auto& [column, right] : block.coupling) {
          hessian.block<6, 6>(row, column) -= eliminated * right.transpose();
        }
      }
    }
    const Eigen::VectorXd step = -hessian.ldlt().solve(gradient);
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      Eigen::Vector3d right = -blocks[i].gradient;
      for (const auto& [at, coupling] : blocks[i].coupling) {
        right -= coupling.transpose() * step.segment<6>(at);
      }
      tracks_[i]->point += blocks[i].inverse * right;
    }
    for (std::size_t k = 0; k < free; ++k) {
      Eigen::Isometry3d& pose = keyframes_[first_free_ + k];
      pose = moved(pose, step.segment<6>(static_cast<Eigen::Index>(6 * k)));
    }
  }

  const Camera& camera_;
  Keyframes& keyframes_;
  std::vector<Track*> tracks_;
  std::size_t first_ = 0;
  std::size_t first_free_ = 0;
};

}  // namespace

void adjust(const Camera& camera, Keyframes& keyframes, std::vector<Track>& tracks,
            std::size_t window, std::size_t fixed) {
  Problem(camera, keyframes, tracks, window, fixed).solve();
}

}  // namespace orbbuf::evaluation
