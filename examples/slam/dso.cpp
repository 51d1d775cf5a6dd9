// SPDX-License-Identifier: Apache-2.0
// DSO (github.com/JakobEngel/dso) on live frames; DSO's own program reads folders only.
//
//   orbbuf-dso CAMERA_TXT TRAJECTORY < frames
//
// TRAJECTORY gets the camera's poses at the end of the stream (TUM). Exit status 1: tracking was
// lost. Of stereo frames DSO gets the left images.
#include <orbbuf/pipe.h>

#include <iostream>
#include <memory>

#include "FullSystem/FullSystem.h"
#include "util/ImageAndExposure.h"
#include "util/MinimalImage.h"
#include "util/Undistort.h"
#include "util/globalCalib.h"
#include "util/settings.h"

namespace {

/// For cameras without a photometric calibration (DSO's mode=1).
void configure() {
  dso::setting_photometricCalibration = 0;
  dso::setting_affineOptModeA = 0;
  dso::setting_affineOptModeB = 0;
  dso::setting_onlyLogKFPoses = false;  // TRAJECTORY has each frame
  dso::setting_logStuff = false;
  dso::setting_debugout_runquiet = true;
  dso::disableAllDisplay = true;
}

std::unique_ptr<dso::FullSystem> make_system() {
  auto system = std::make_unique<dso::FullSystem>();
  system->linearizeOperation = false;  // live: mapping does not hold tracking
  return system;
}

/// False: lost.
bool track(orbbuf_reader& reader, const dso::Undistort& undistort, const char* trajectory) {
  auto system = make_system();
  orbbuf_image image;
  int got = 0;
  for (int id = 0; !system->isLost && (got = orbbuf_read(&reader, &image)) == 1;) {
    if (image.camera == ORBBUF_RIGHT) continue;
    const dso::MinimalImageB pixels(static_cast<int>(image.width), static_cast<int>(image.height),
                                    const_cast<unsigned char*>(image.data));
    const std::unique_ptr<dso::ImageAndExposure> frame(
        undistort.undistort<unsigned char>(&pixels, 1, image.t, 1));
    system->addActiveFrame(frame.get(), id++);
    if (system->initFailed || dso::setting_fullResetRequested) {
      system = make_system();
      dso::setting_fullResetRequested = false;
      id = 0;
    }
  }
  if (got < 0) std::cerr << "orbbuf-dso: " << reader.error << '\n';
  system->blockUntilMappingIsFinished();
  system->printResult(trajectory);
  return !system->isLost;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: orbbuf-dso CAMERA_TXT TRAJECTORY < frames\n";
    return 2;
  }
  configure();
  const std::unique_ptr<dso::Undistort> undistort(
      dso::Undistort::getUndistorterForFile(argv[1], "", ""));
  if (!undistort || !undistort->isValid()) {
    std::cerr << "orbbuf-dso: cannot use the calibration " << argv[1] << '\n';
    return 2;
  }
  const auto size = undistort->getSize();
  dso::setGlobalCalib(size[0], size[1], undistort->getK().cast<float>());
  orbbuf_reader reader;
  orbbuf_reader_init(&reader, stdin);
  const bool is_tracked = track(reader, *undistort, argv[2]);
  orbbuf_reader_free(&reader);
  return is_tracked ? 0 : 1;
}
