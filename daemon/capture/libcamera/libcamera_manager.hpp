// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

namespace libcamera {
class Camera;
class CameraManager;
}  // namespace libcamera

namespace orbbuf {

/// The process's only CameraManager, shared by all streams and stopped with the last of them; a new
/// one searches for cameras again. It must outlive the cameras that it returns. Starts it, and with
/// it libcamera's thread, if it does not run; waits for one that is stopping. libcamera logs to
/// stderr: warnings, and more if `[log] level` is debug or trace, unless LIBCAMERA_LOG_LEVELS is
/// set. Thread-safe. Throws std::runtime_error.
std::shared_ptr<libcamera::CameraManager> libcamera_manager();

/// The camera with this id or, if there is none, at this place in the list. Throws
/// std::runtime_error with a list of the cameras.
std::shared_ptr<libcamera::Camera> find_libcamera(libcamera::CameraManager& manager,
                                                  const std::string& camera);

/// Every camera that libcamera has, with place, id, model, formats, sizes and controls, for
/// --list-cameras. Throws std::runtime_error.
std::string list_libcamera();

}  // namespace orbbuf
