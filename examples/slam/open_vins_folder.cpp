// SPDX-License-Identifier: Apache-2.0
// OpenVINS (github.com/rpng/open_vins, built without ROS) on the folder of an outage list, one
// camera (evaluation/outages/README.md), and on samples that `orbbuf-imu` has made.
//
//   orbbuf-open-vins-folder CONFIG FOLDER IMU TRUTH TRAJECTORY [LOST_FROM LOST_UNTIL]
//
// Starts at the first frame with the pose and the speed of TRUTH (TUM; z is up), and without bias,
// so that no run depends on luck in its first second. Samples of the times from LOST_FROM to
// LOST_UNTIL (seconds) are left out.
#include <core/VioManager.h>
#include <core/VioManagerOptions.h>
#include <state/State.h>
#include <utils/opencv_yaml_parse.h>
#include <utils/sensor_data.h>

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string>
#include <vector>

namespace {

struct Pose {
  double time_s = 0;
  Eigen::Vector3d place;
  Eigen::Vector4d turn;  // x y z w
};

std::vector<Pose> read_poses(const std::string& file) {
  std::vector<Pose> poses;
  std::ifstream in(file);
  Pose pose;
  while (in >> pose.time_s >> pose.place[0] >> pose.place[1] >> pose.place[2] >> pose.turn[0] >>
         pose.turn[1] >> pose.turn[2] >> pose.turn[3]) {
    poses.push_back(pose);
  }
  return poses;
}

/// The state at the first pose; the speed is that of the parabola through three.
Eigen::Matrix<double, 17, 1> first_state(const std::vector<Pose>& poses) {
  Eigen::Matrix<double, 17, 1> state = Eigen::Matrix<double, 17, 1>::Zero();
  state << poses[0].time_s, poses[0].turn, poses[0].place,
      (4 * poses[1].place - 3 * poses[0].place - poses[2].place) /
          (poses[2].time_s - poses[0].time_s),
      Eigen::Matrix<double, 6, 1>::Zero();
  return state;
}

/// Gives the filter the samples up to the first one after `time_s`. False: there is none.
bool feed_samples_until(double time_s, std::istream& in, double lost_from_s, double lost_until_s,
                        ov_msckf::VioManager& vio, double& last_s) {
  std::string line;
  while (last_s <= time_s && std::getline(in, line)) {
    std::int64_t time_ns = 0;
    ov_core::ImuData imu;
    if (std::sscanf(line.c_str(), "%" SCNd64 ",%lf,%lf,%lf,%lf,%lf,%lf", &time_ns, &imu.wm[0],
                    &imu.wm[1], &imu.wm[2], &imu.am[0], &imu.am[1], &imu.am[2]) != 7) {
      continue;  // the heading
    }
    imu.timestamp = static_cast<double>(time_ns) * 1e-9;
    if (imu.timestamp >= lost_from_s && imu.timestamp < lost_until_s) continue;
    last_s = imu.timestamp;
    vio.feed_measurement_imu(imu);
  }
  return last_s > time_s;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6 && argc != 8) {
    std::cerr << "usage: orbbuf-open-vins-folder CONFIG FOLDER IMU TRUTH TRAJECTORY "
                 "[LOST_FROM LOST_UNTIL]\n";
    return 2;
  }
  cv::setNumThreads(1);  // the same figures each time
  const auto parser = std::make_shared<ov_core::YamlParser>(argv[1]);
  ov_msckf::VioManagerOptions options;
  options.print_and_load(parser);
  const std::vector<Pose> truth = read_poses(argv[4]);
  if (!parser->successful() || truth.size() < 3) return 2;
  ov_msckf::VioManager vio(options);
  vio.initialize_with_gt(first_state(truth));
  const double lost_from_s = argc == 8 ? std::atof(argv[6]) : 0;
  const double lost_until_s = argc == 8 ? std::atof(argv[7]) : 0;
  const std::string folder = argv[2];
  std::ifstream times(folder + "/times.txt");
  std::ifstream samples(argv[3]);
  std::ofstream out(argv[5]);
  out << std::fixed << std::setprecision(9);
  double last_s = -1;
  std::string line;
  while (std::getline(times, line)) {
    long number = 0;
    ov_core::CameraData frame;
    std::istringstream(line) >> number >> frame.timestamp;
    if (!feed_samples_until(frame.timestamp, samples, lost_from_s, lost_until_s, vio, last_s))
      break;
    std::ostringstream name;
    name << folder << "/images/" << std::setw(6) << std::setfill('0') << number << ".jpg";
    frame.sensor_ids.push_back(0);
    frame.images.push_back(cv::imread(name.str(), cv::IMREAD_GRAYSCALE));
    if (frame.images[0].empty()) {
      std::cerr << "orbbuf-open-vins-folder: cannot read " << name.str() << '\n';
      return 1;
    }
    frame.masks.push_back(cv::Mat::zeros(frame.images[0].size(), CV_8UC1));
    vio.feed_measurement_camera(frame);
    const auto place = vio.get_state()->_imu->pos();
    const auto turn = vio.get_state()->_imu->quat();  // JPL, as in open_vins.cpp
    out << frame.timestamp << ' ' << place.transpose() << ' ' << turn.transpose() << '\n';
  }
}
