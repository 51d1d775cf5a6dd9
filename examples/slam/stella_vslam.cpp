// SPDX-License-Identifier: Apache-2.0
// stella_vslam (github.com/stella-cv/stella_vslam) on live frames, mono or stereo as they come.
//
//   orbbuf-stella-vslam VOCABULARY CONFIG TRAJECTORY < frames
//
// CONFIG is stella_vslam's YAML file with the camera: `setup: monocular` or `setup: stereo`.
// TRAJECTORY gets the poses of all frames at the end of the stream (TUM).
#include <orbbuf/pipe.h>
#include <stella_vslam/config.h>
#include <stella_vslam/system.h>

#include <chrono>
#include <iostream>
#include <memory>
#include <opencv2/core.hpp>
#include <thread>

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: orbbuf-stella-vslam VOCABULARY CONFIG TRAJECTORY < frames\n";
    return 2;
  }
  stella_vslam::system slam(std::make_shared<stella_vslam::config>(argv[2]), argv[1]);
  slam.startup();
  cv::Mat left;
  orbbuf_reader reader;
  orbbuf_image image;
  int got = 0;
  orbbuf_reader_init(&reader, stdin);
  while (!slam.terminate_is_requested() && (got = orbbuf_read(&reader, &image)) == 1) {
    const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC1,
                         const_cast<unsigned char*>(image.data));
    if (image.camera == ORBBUF_MONO) slam.feed_monocular_frame(pixels, image.t);
    if (image.camera == ORBBUF_LEFT) left = pixels.clone();  // the right one is next
    if (image.camera == ORBBUF_RIGHT) slam.feed_stereo_frame(left, pixels, image.t);
  }
  if (got < 0) std::cerr << "orbbuf-stella-vslam: " << reader.error << '\n';
  orbbuf_reader_free(&reader);
  while (slam.loop_BA_is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  slam.shutdown();
  slam.save_frame_trajectory(argv[3], "TUM");
}
