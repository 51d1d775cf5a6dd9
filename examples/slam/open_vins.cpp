// SPDX-License-Identifier: Apache-2.0
// OpenVINS (github.com/rpng/open_vins, built without ROS) on live frames, mono or stereo.
//
//   orbbuf-open-vins CONFIG IMU TRAJECTORY < frames
//
// CONFIG is OpenVINS's estimator_config.yaml. OpenVINS needs an IMU, which ORBBuf does not carry.
// IMU is a file or FIFO with lines as EuRoC has them, in the same clock as the frames:
// nanoseconds, angular velocity (rad/s) x, y, z, acceleration (m/s^2) x, y, z, separated by commas.
// TRAJECTORY gets the IMU's pose after each frame (TUM).
#include <core/VioManager.h>
#include <core/VioManagerOptions.h>
#include <orbbuf/pipe.h>
#include <state/State.h>
#include <utils/opencv_yaml_parse.h>
#include <utils/sensor_data.h>

#include <cinttypes>
#include <cstdio>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <memory>
#include <opencv2/core.hpp>
#include <string>

namespace {

/// Gives the filter all measurements up to the first one after `time_s`, as a frame needs them.
/// Waits for a FIFO. False: the IMU's data end before.
bool feed_imu_until(std::istream& in, double time_s, ov_msckf::VioManager& vio, double& last_s) {
  std::string line;
  while (last_s <= time_s && std::getline(in, line)) {
    std::int64_t time_ns = 0;
    ov_core::ImuData imu;
    if (std::sscanf(line.c_str(), "%" SCNd64 ",%lf,%lf,%lf,%lf,%lf,%lf", &time_ns, &imu.wm[0],
                    &imu.wm[1], &imu.wm[2], &imu.am[0], &imu.am[1], &imu.am[2]) != 7) {
      continue;  // a heading
    }
    imu.timestamp = last_s = static_cast<double>(time_ns) * 1e-9;
    vio.feed_measurement_imu(imu);
  }
  return last_s > time_s;
}

void write_pose(std::ostream& out, ov_msckf::VioManager& vio) {
  if (!vio.initialized()) return;
  const auto state = vio.get_state();
  const auto p = state->_imu->pos();
  const auto q = state->_imu->quat();  // JPL, world to IMU: the numbers of Hamilton's IMU to world
  out << state->_timestamp << ' ' << p[0] << ' ' << p[1] << ' ' << p[2] << ' ' << q[0] << ' '
      << q[1] << ' ' << q[2] << ' ' << q[3] << std::endl;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: orbbuf-open-vins CONFIG IMU TRAJECTORY < frames\n";
    return 2;
  }
  const auto parser = std::make_shared<ov_core::YamlParser>(argv[1]);
  ov_msckf::VioManagerOptions options;
  options.print_and_load(parser);
  if (!parser->successful()) return 2;
  ov_msckf::VioManager vio(options);
  std::ifstream imu(argv[2]);
  std::ofstream trajectory(argv[3]);
  trajectory << std::fixed << std::setprecision(9);
  double last_imu_s = 0;
  ov_core::CameraData frame;
  orbbuf_reader reader;
  orbbuf_image image;
  int got = 0;
  orbbuf_reader_init(&reader, stdin);
  while ((got = orbbuf_read(&reader, &image)) == 1) {
    const int id = image.camera == ORBBUF_RIGHT ? 1 : 0;
    if (id == 0) frame = {};
    frame.timestamp = image.t;
    frame.sensor_ids.push_back(id);
    const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC1,
                         const_cast<unsigned char*>(image.data));
    frame.images.push_back(pixels.clone());
    frame.masks.push_back(cv::Mat::zeros(pixels.size(), CV_8UC1));
    if (image.camera == ORBBUF_LEFT) continue;  // the right one is next
    const double offset_s = vio.get_state()->_calib_dt_CAMtoIMU->value()(0);
    if (!feed_imu_until(imu, image.t + offset_s, vio, last_imu_s)) {
      std::cerr << "orbbuf-open-vins: the IMU's data end before frame " << image.seq << '\n';
      break;
    }
    vio.feed_measurement_camera(frame);
    write_pose(trajectory, vio);
  }
  if (got < 0) std::cerr << "orbbuf-open-vins: " << reader.error << '\n';
  orbbuf_reader_free(&reader);
}
