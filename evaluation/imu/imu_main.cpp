// SPDX-License-Identifier: Apache-2.0
// orbbuf-imu: the samples of an inertial sensor that moves as the camera of a trajectory does, in
// the form of EuRoC's imu0/data.csv. The sensor has the camera's axes and place.
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "bench/run_program.hpp"
#include "common/command_line.hpp"
#include "evaluation/imu/motion.hpp"

namespace orbbuf::evaluation {
namespace {

struct Options {
  std::filesystem::path truth;
  std::filesystem::path out;
  std::string grade = "mpu6050";
  std::string up = "z";
  double rate_hz = 200;
  double scale = 1;
  std::uint64_t seed = 1;
};

void run(const Options& options) {
  Trajectory truth = read_trajectory(options.truth);
  for (StampedPose& pose : truth) pose.pose.translation() *= options.scale;
  const Eigen::Vector3d up =
      options.up == "z" ? Eigen::Vector3d(0, 0, 1) : Eigen::Vector3d(0, -1, 0);
  const ImuGrade& grade = *std::ranges::find(imu_grades(), options.grade, &ImuGrade::name);
  std::ofstream out(options.out);
  out << kEurocImuHeader;
  for (const Sample& sample :
       imu_samples(Motion(truth), options.rate_hz, up, grade, options.seed)) {
    out << to_euroc_line(sample);
  }
  if (!out.flush()) throw std::runtime_error("cannot write " + options.out.string());
}

}  // namespace
}  // namespace orbbuf::evaluation

int main(int argc, char** argv) {
  orbbuf::evaluation::Options options;
  std::vector<std::string> grades;
  for (const auto& grade : orbbuf::evaluation::imu_grades()) grades.push_back(grade.name);
  orbbuf::CommandLine app("The samples of an inertial sensor that moves as a trajectory says");
  app.add_option("truth", options.truth, "the camera's poses, in TUM's form").required();
  app.add_option("out", options.out, "EuRoC's imu0/data.csv").required();
  app.add_option("--grade", options.grade, "noise and bias").one_of(grades).with_default();
  app.add_option("--up", options.up, "axis of the world that points up")
      .one_of({"z", "-y"})
      .with_default();
  app.add_option("--rate", options.rate_hz, "samples in a second").in_range(1, 1e5).with_default();
  app.add_option("--scale", options.scale, "metres in the unit of the trajectory").with_default();
  app.add_option("--seed", options.seed).with_default();
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("orbbuf-imu", [&] { orbbuf::evaluation::run(options); });
}
