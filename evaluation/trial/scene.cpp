// SPDX-License-Identifier: Apache-2.0
#include "evaluation/trial/scene.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <limits>
#include <mutex>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "common/progress.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kTimesAsWrong = 3;
constexpr double kShareOfPath = 0.02;

SourceSettings source_of(const std::filesystem::path& folder, const Camera& camera) {
  SourceSettings source;
  source.kind = "folder";
  source.path = folder / "images";
  if (camera.is_stereo()) source.path_right = folder / "images_right";
  return source;
}

}  // namespace

void for_each_parallel(const std::string& name, std::size_t count,
                       const std::function<void(std::size_t)>& work) {
  Progress progress(name, "runs", count);
  std::atomic<std::size_t> next = 0;
  std::mutex mutex;
  std::exception_ptr failure;
  std::vector<std::jthread> threads;
  for (unsigned t = 0; t < std::max(1U, std::thread::hardware_concurrency()); ++t) {
    threads.emplace_back([&] {
      try {
        for (std::size_t i = next++; i < count; i = next++) {
          work(i);
          progress.add();
        }
      } catch (...) {
        const std::lock_guard lock(mutex);
        failure = std::current_exception();
        next = count;
      }
    });
  }
  threads.clear();
  if (failure) std::rethrow_exception(failure);
}

Scene::Scene(const std::filesystem::path& folder)
    : camera_(read_camera(folder / "camera.txt")),
      truth_(read_trajectory(folder / "truth.txt")),
      list_(list_frames(folder)),
      images_(list_.size()),
      sequence_(folder.filename().string(), source_of(folder, camera_)) {
  cv::setNumThreads(1);
  for_each_parallel("read", list_.size(), [&](std::size_t i) {
    images_[i] = load_frame(folder, list_[i], camera_.is_stereo());
  });
  Progress progress("track the unbroken sequence", "frames", images_.size());
  ReferenceVo vo(camera_);
  for (std::size_t i = 0; i < images_.size(); ++i) {
    if (i % kCheckpoint == 0) checkpoints_.push_back(vo);
    vo.track(images_[i], i);
    progress.add();
  }
  checkpoints_.push_back(vo);
}

double Scene::motion_m(std::size_t i, std::size_t j) const {
  constexpr double kMetresARadian = 18 / std::numbers::pi;
  const Eigen::Isometry3d moved = truth_[i].pose.inverse() * truth_[j].pose;
  return moved.translation().norm() + kMetresARadian * Eigen::AngleAxisd(moved.rotation()).angle();
}

TrackingResult Scene::track(const std::vector<std::size_t>& received, std::size_t end) const {
  std::size_t same = 0;
  while (same < received.size() && received[same] == same) ++same;
  const std::size_t checkpoint = std::min(same / kCheckpoint, checkpoints_.size() - 2);
  ReferenceVo vo = checkpoints_[checkpoint];
  for (std::size_t k = checkpoint * kCheckpoint; k < received.size() && received[k] < end; ++k) {
    vo.track(images_[received[k]], received[k]);
    if (vo.result().is_lost()) break;
  }
  return vo.result();
}

TrajectoryError Scene::error(const Trajectory& trajectory, const Stretch& stretch) const {
  Trajectory part;
  const double begin_s = list_[stretch.begin].time_s - 1e-6;
  const double end_s = list_[std::min(stretch.end, list_.size()) - 1].time_s + 1e-6;
  for (const StampedPose& pose : trajectory) {
    if (pose.time_s >= begin_s && pose.time_s <= end_s) part.push_back(pose);
  }
  return compare(part, truth_, !camera_.is_stereo());
}

bool Scene::survives(const std::vector<std::size_t>& received, const Stretch& stretch) const {
  const TrackingResult result = track(received, stretch.end);
  if (result.is_lost() || result.trajectory.empty()) return false;
  const auto after = std::ranges::lower_bound(received, stretch.end);
  if (after == received.begin()) return false;
  if (result.trajectory.back().time_s < list_[*std::prev(after)].time_s - 1e-6) return false;
  const TrajectoryError own = error(result.trajectory, stretch);
  const TrajectoryError best = error(unbroken().trajectory, stretch);
  return own.ate_m <= std::max(kTimesAsWrong * best.ate_m, kShareOfPath * best.path_m);
}

std::vector<std::size_t> Scene::only_in(const std::vector<std::size_t>& received,
                                        const Stretch& stretch) const {
  std::vector<std::size_t> frames(std::min(stretch.begin, size()));
  std::iota(frames.begin(), frames.end(), 0);
  for (const std::size_t frame : received) {
    if (frame >= stretch.begin && frame < stretch.end) frames.push_back(frame);
  }
  return frames;
}

double Scene::ate_ratio(const std::vector<std::size_t>& received) const {
  constexpr double kLost = std::numeric_limits<double>::infinity();
  const TrackingResult result = track(received, size());
  if (result.is_lost() || !reaches(result.trajectory, list_.back().time_s)) return kLost;
  const Stretch all{0, size()};
  const TrajectoryError own = error(result.trajectory, all);
  return own.poses < 3 ? kLost : own.ate_m / error(unbroken().trajectory, all).ate_m;
}

std::optional<Stretch> stretch_around(const Outage& outage, std::span<const std::size_t> received,
                                      double fps, std::size_t frames) {
  const auto back = std::ranges::lower_bound(received, static_cast<std::size_t>(outage.end));
  if (back == received.end()) return std::nullopt;
  const double before = std::max(0.0, outage.begin - kScoredBeforeS * fps);
  const double after = static_cast<double>(*back) + kScoredAfterS * fps;
  return Stretch{static_cast<std::size_t>(before),
                 std::min(frames, static_cast<std::size_t>(after))};
}

std::size_t longest_gap(std::span<const std::size_t> received, const Stretch& stretch) {
  std::size_t longest = 0;
  std::size_t expected = stretch.begin;
  for (const std::size_t frame : received) {
    if (frame < stretch.begin || frame >= stretch.end) continue;
    longest = std::max(longest, frame - expected);
    expected = frame + 1;
  }
  return std::max(longest, std::max(stretch.end, expected) - expected);
}

Session read_session(const std::string& named) {
  const auto equals = named.find('=');
  const auto at = named.find('@');
  if (at == std::string::npos || equals == std::string::npos || at > equals) {
    throw std::runtime_error("expected CONTENDER@RUN=FOLDER, not " + named);
  }
  Session session{
      named.substr(0, equals), named.substr(0, at), named.substr(at + 1, equals - at - 1), {}};
  for (const ListedFrame& frame : list_frames(named.substr(equals + 1))) {
    session.received.push_back(frame.id);
  }
  return session;
}

}  // namespace orbbuf::evaluation
