// SPDX-License-Identifier: Apache-2.0
// RTAB-Map (github.com/introlab/rtabmap) on live stereo frames, which must be rectified.
//
//   orbbuf-rtabmap FX FY CX CY BASELINE DATABASE TRAJECTORY < frames
//
// FX, FY, CX, CY are in pixels, BASELINE in metres. DATABASE gets the map, for
// rtabmap-databaseViewer. TRAJECTORY gets the left camera's pose after each frame, as corrected at
// that time (TUM).
#include <orbbuf/pipe.h>
#include <rtabmap/core/Odometry.h>
#include <rtabmap/core/OdometryInfo.h>
#include <rtabmap/core/Rtabmap.h>
#include <rtabmap/core/SensorData.h>
#include <rtabmap/core/StereoCameraModel.h>

#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <memory>
#include <opencv2/core.hpp>

namespace {

struct Slam {
  std::unique_ptr<rtabmap::Odometry> odometry{rtabmap::Odometry::create()};
  rtabmap::Rtabmap map;
  rtabmap::StereoCameraModel camera;
  std::ofstream trajectory;
};

void write_pose(std::ostream& out, double time_s, const rtabmap::Transform& pose) {
  const auto q = pose.getQuaternionf();
  out << time_s << ' ' << pose.x() << ' ' << pose.y() << ' ' << pose.z() << ' ' << q.x() << ' '
      << q.y() << ' ' << q.z() << ' ' << q.w() << std::endl;
}

void track(Slam& slam, const cv::Mat& left, const cv::Mat& right, const orbbuf_image& image) {
  rtabmap::SensorData frame(left, right, slam.camera, 0, image.t);
  rtabmap::OdometryInfo info;
  const rtabmap::Transform pose = slam.odometry->process(frame, &info);
  if (pose.isNull()) {
    std::cerr << "orbbuf-rtabmap: lost at frame " << image.seq << '\n';
    return slam.odometry->reset(slam.odometry->getPose());
  }
  slam.map.process(frame, pose, info.reg.covariance);
  write_pose(slam.trajectory, image.t,
             slam.map.getMapCorrection() * pose * slam.camera.localTransform());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 8) {
    std::cerr << "usage: orbbuf-rtabmap FX FY CX CY BASELINE DATABASE TRAJECTORY < frames\n";
    return 2;
  }
  Slam slam;
  slam.map.init(rtabmap::ParametersMap(), argv[6]);
  slam.trajectory.open(argv[7]);
  slam.trajectory << std::fixed << std::setprecision(9);
  cv::Mat left;
  orbbuf_reader reader;
  orbbuf_image image;
  int got = 0;
  orbbuf_reader_init(&reader, stdin);
  while ((got = orbbuf_read(&reader, &image)) == 1) {
    if (image.camera == ORBBUF_MONO) {
      std::cerr << "orbbuf-rtabmap: the frames are not stereo\n";
      return 2;
    }
    const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC1,
                         const_cast<unsigned char*>(image.data));
    if (image.camera == ORBBUF_LEFT) {
      left = pixels.clone();
      const auto number = [&](int i) { return std::atof(argv[i]); };
      if (!slam.camera.isValidForProjection()) {
        slam.camera =
            rtabmap::StereoCameraModel(number(1), number(2), number(3), number(4), number(5),
                                       rtabmap::CameraModel::opticalRotation(), left.size());
      }
    } else {
      track(slam, left, pixels.clone(), image);
    }
  }
  if (got < 0) std::cerr << "orbbuf-rtabmap: " << reader.error << '\n';
  orbbuf_reader_free(&reader);
  slam.map.close();
}
