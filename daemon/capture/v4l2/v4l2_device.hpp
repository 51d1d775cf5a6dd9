// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "common/unique_fd.hpp"
#include "daemon/capture/camera_formats.hpp"

namespace orbbuf {

/// The opened file is not a V4L2 capture node.
class NoCamera : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An open V4L2 capture device and its capabilities. Thread-bound.
class V4l2Device {
 public:
  /// path: of a video node or of a link to one. Throws std::runtime_error with the reason and a
  /// list of the nodes if it cannot be opened, and NoCamera if it is not a capture node.
  explicit V4l2Device(std::string path);

  const std::string& path() const { return path_; }
  const std::string& name() const { return name_; }  ///< of the camera, for people
  const std::string& bus() const { return bus_; }    ///< where it is plugged in
  int fd() const { return fd_.get(); }

  /// Every format, with its sizes and rates.
  std::vector<CameraOffer> offers() const;

  /// ioctl(2), begun again when a signal interrupts it. Returns 0 or errno.
  int call(unsigned long request, void* argument) const;

  /// call() for what must not fail. Throws std::runtime_error: `camera PATH: cannot ATTEMPT: why`.
  void must(std::string_view attempt, unsigned long request, void* argument) const;

  /// Throws as must() does, for the errno value `error`. hint: what its text does not say.
  [[noreturn]] void fail(std::string_view attempt, int error, std::string_view hint = "") const;

 private:
  std::string path_;
  std::string name_;
  std::string bus_;
  UniqueFd fd_;
};

/// The command that resets the USB port of the camera behind `node`, or behind a link to one, which
/// is as if it were plugged in again. Empty: it is at no USB port. sys: where sysfs is.
std::string usb_reset_command(const std::filesystem::path& node,
                              const std::filesystem::path& sys = "/sys");

/// The video nodes of this machine (/dev/video*), by number. Not all of them capture.
std::vector<std::string> video_nodes();

}  // namespace orbbuf
