// SPDX-License-Identifier: Apache-2.0
#include "evaluation/outages/truth.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>

namespace orbbuf::evaluation {
namespace {

constexpr double kSameTimeS = 1e-3;
constexpr double kLongestGapS = 1;  // that is interpolated
constexpr std::size_t kKittiNumbers = 12;

std::vector<double> numbers_of(const std::string& line) {
  std::istringstream in(line);
  return {std::istream_iterator<double>(in), {}};
}

std::optional<Eigen::Isometry3d> between(const Trajectory& truth, double time_s) {
  const auto after = std::ranges::lower_bound(truth, time_s, {}, &StampedPose::time_s);
  if (after != truth.end() && after->time_s - time_s < kSameTimeS) return after->pose;
  if (after == truth.begin()) return std::nullopt;
  const StampedPose& before = *(after - 1);
  if (time_s - before.time_s < kSameTimeS) return before.pose;
  if (after == truth.end() || after->time_s - before.time_s > kLongestGapS) return std::nullopt;
  const double share = (time_s - before.time_s) / (after->time_s - before.time_s);
  const Eigen::Quaterniond turn = Eigen::Quaterniond(before.pose.rotation())
                                      .slerp(share, Eigen::Quaterniond(after->pose.rotation()));
  Eigen::Isometry3d pose(turn);
  pose.translation() = (1 - share) * before.pose.translation() + share * after->pose.translation();
  return pose;
}

}  // namespace

std::vector<std::optional<Eigen::Isometry3d>> truth_of_frames(const std::filesystem::path& file,
                                                              const std::vector<double>& times_s) {
  std::ifstream in(file);
  std::string line;
  std::vector<std::optional<Eigen::Isometry3d>> poses;
  while (std::getline(in, line)) {
    const std::vector<double> n = numbers_of(line);
    if (n.size() != kKittiNumbers) break;
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.matrix().topRows<3>() =
        Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(n.data());
    poses.emplace_back(pose);
  }
  if (!poses.empty()) {
    poses.resize(times_s.size());
    return poses;
  }
  const Trajectory truth = read_trajectory(file);
  for (const double time_s : times_s) poses.push_back(between(truth, time_s));
  return poses;
}

}  // namespace orbbuf::evaluation
