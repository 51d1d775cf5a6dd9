// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

namespace libcamera {
class Camera;
class CameraManager;
}  // namespace libcamera

namespace orbbuf {

/// The one CameraManager that a process may have, shared by whoever films and ended with the last
/// of them: a new one looks for cameras anew. It must outlive the cameras that it gives. Starts it,
/// and with it libcamera's thread, if it is not there; waits for one that is just ending. Its own
/// messages go to stderr: warnings, and more where `[log] level` is debug or trace, unless
/// LIBCAMERA_LOG_LEVELS is set. Thread-safe. Throws std::runtime_error.
std::shared_ptr<libcamera::CameraManager> libcamera_manager();

/// The camera of this id or, where no id is like it, of this place in the list. Throws
/// std::runtime_error naming those there are.
std::shared_ptr<libcamera::Camera> find_libcamera(libcamera::CameraManager& manager,
                                                  const std::string& camera);

/// Every camera that libcamera has, with place, id, model, formats, sizes and controls, for
/// --list-cameras. Throws std::runtime_error.
std::string list_libcamera();

}  // namespace orbbuf
