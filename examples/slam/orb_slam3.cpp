// SPDX-License-Identifier: Apache-2.0
// ORB-SLAM3 (github.com/UZ-SLAMLab/ORB_SLAM3) on live frames, mono or stereo as they come.
//
//   orbbuf-orb-slam3 VOCABULARY SETTINGS TRAJECTORY < frames
//
// SETTINGS is ORB-SLAM3's YAML file with the camera. TRAJECTORY gets the keyframes' poses at the
// end of the stream (TUM).
#include <System.h>
#include <orbbuf/pipe.h>

#include <iostream>
#include <memory>
#include <opencv2/core.hpp>

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: orbbuf-orb-slam3 VOCABULARY SETTINGS TRAJECTORY < frames\n";
    return 2;
  }
  using ORB_SLAM3::System;
  std::unique_ptr<System> slam;
  cv::Mat left;
  orbbuf_reader reader;
  orbbuf_image image;
  int got = 0;
  orbbuf_reader_init(&reader, stdin);
  while ((got = orbbuf_read(&reader, &image)) == 1) {
    if (!slam) {
      const auto sensor = image.camera == ORBBUF_MONO ? System::MONOCULAR : System::STEREO;
      slam = std::make_unique<System>(argv[1], argv[2], sensor, false);
    }
    const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC1,
                         const_cast<unsigned char*>(image.data));
    if (image.camera == ORBBUF_MONO) slam->TrackMonocular(pixels, image.t);
    if (image.camera == ORBBUF_LEFT) left = pixels.clone();  // the right one is next
    if (image.camera == ORBBUF_RIGHT) slam->TrackStereo(left, pixels, image.t);
  }
  if (got < 0) std::cerr << "orbbuf-orb-slam3: " << reader.error << '\n';
  orbbuf_reader_free(&reader);
  if (!slam) return 1;
  slam->Shutdown();
  slam->SaveKeyFrameTrajectoryTUM(argv[3]);
}
