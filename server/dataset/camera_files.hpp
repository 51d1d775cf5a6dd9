// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/dataset/dataset.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf {

bool is_stereo(const RecordedSession& session);

/// Add to `dataset` what camera.txt says, in the layout's own form, and a note for what that form
/// cannot say. The right camera is known only by a baseline, which means rectified images: the
/// same numbers, at that distance.

/// EuRoC's sensor.yaml: every model, FOV in the form of Kalibr's `fov`.
void add_euroc_camera(const RecordedSession& session, Dataset& dataset);
/// KITTI's calib.txt, of a camera without lens distortion only.
void add_kitti_camera(const RecordedSession& session, Dataset& dataset);

}  // namespace orbbuf
