// SPDX-License-Identifier: Apache-2.0
// orbbuf-odometry: does SLAM survive on these frames? Runs a visual odometry over a folder of
// orbbuf-world or a session of orbbuf-server, or live on the standard input as [slam] command; or
// has any SLAM program do it (--slam). Prints a result, then RESULT lines.
#include <fmt/core.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "bench/run_program.hpp"
#include "common/command_line.hpp"
#include "common/progress.hpp"
#include "evaluation/odometry/frames.hpp"
#include "evaluation/odometry/reference_vo.hpp"

namespace orbbuf::evaluation {
namespace {

struct Options {
  std::filesystem::path folder;
  std::filesystem::path camera;
  std::filesystem::path truth;
  std::filesystem::path trajectory;
  std::string slam;
  std::vector<std::uint64_t> without;
};

TrackingResult track_pipe(const Camera& camera) {
  ReferenceVo vo(camera);
  Pipe pipe(stdin);
  while (const auto next = pipe.next(camera.is_stereo())) vo.track(next->frame, next->id);
  return vo.result();
}

TrackingResult track_folder(const Options& options, const Camera& camera) {
  auto frames = list_frames(options.folder);
  if (!options.without.empty()) {
    const std::uint64_t first = options.without[0];
    std::erase_if(frames, [&](const ListedFrame& frame) {
      return frame.id >= first && frame.id - first < options.without[1];
    });
  }
  ReferenceVo vo(camera);
  Progress progress("track", "frames", frames.size());
  for (const ListedFrame& frame : frames) {
    vo.track(load_frame(options.folder, frame, camera.is_stereo()), frame.id);
    progress.add();
  }
  return vo.result();
}

/// One word for a shell, whatever is in it.
std::string quoted(const std::filesystem::path& path) {
  std::string word = "'";
  for (const char c : std::filesystem::absolute(path).string()) {
    word += c == '\'' ? R"('\'')" : std::string(1, c);
  }
  return word + "'";
}

void replace(std::string& text, const std::string& name, const std::filesystem::path& path) {
  const std::string word = quoted(path);
  for (auto at = text.find(name); at != std::string::npos; at = text.find(name, at + word.size())) {
    text.replace(at, name.size(), word);
  }
}

TrackingResult track_other(const Options& options, const std::filesystem::path& camera) {
  std::string command = options.slam;
  replace(command, "{images}", options.folder / "images");
  replace(command, "{calib}", camera);
  replace(command, "{times}", options.folder / "times.txt");
  replace(command, "{trajectory}", options.trajectory);
  std::filesystem::remove(options.trajectory);
  if (std::system(command.c_str()) != 0) throw std::runtime_error("failed: " + command);
  return result_of(read_trajectory(options.trajectory), list_frames(options.folder));
}

void run(Options options) {
  if (options.camera.empty()) options.camera = options.folder / "camera.txt";
  const bool is_stereo = read_calibration(options.camera).baseline_m() > 0;
  TrackingResult result;
  if (!options.slam.empty()) {
    if (options.trajectory.empty()) throw std::runtime_error("--slam needs --trajectory");
    result = track_other(options, options.camera);
  } else {
    const Camera camera = read_camera(options.camera);
    result = options.folder.empty() ? track_pipe(camera) : track_folder(options, camera);
    if (!options.trajectory.empty()) write_trajectory(options.trajectory, result.trajectory);
  }
  TrajectoryError error;
  if (!options.truth.empty()) {
    error = compare(result.trajectory, read_trajectory(options.truth), !is_stereo);
  }
  fmt::print("{}\n", to_text(result, error));
  fmt::print("RESULT odometry.tracked_share {:.4f}\nRESULT odometry.lost_at {}\n",
             result.tracked_share(),
             result.lost_at ? static_cast<std::int64_t>(*result.lost_at) : -1);
  if (error.poses >= 3) {
    fmt::print(
        "RESULT odometry.ate_m {:.4f}\nRESULT odometry.ate_share {:.5f}\nRESULT odometry.rpe_m "
        "{:.4f}\n",
        error.ate_m, error.path_m > 0 ? error.ate_m / error.path_m : 0, error.rpe_m);
  }
}

}  // namespace
}  // namespace orbbuf::evaluation

int main(int argc, char** argv) {
  orbbuf::evaluation::Options options;
  orbbuf::CommandLine app("Does SLAM survive on these frames?");
  app.add_option("folder", options.folder,
                 "of orbbuf-world or a session; none: frames from [slam], on the standard input");
  app.add_option("--camera", options.camera, "camera.txt, if not the folder's");
  app.add_option("--truth", options.truth, "the true path (TUM)");
  app.add_option("--trajectory", options.trajectory, "to write what was found to (TUM)");
  app.add_option("--slam", options.slam,
                 "a shell command to run in place of the reference VO; it reads {images}, {calib} "
                 "and {times}, "
                 "and writes {trajectory} (TUM, the camera's pose in the world); these are put in "
                 "quoted. Poses "
                 "of keyframes are enough; without one in the last second it is lost");
  app.add_option("--without", options.without, "FIRST COUNT: frames to leave out").values(2);
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("orbbuf-odometry", [&] { orbbuf::evaluation::run(options); });
}
