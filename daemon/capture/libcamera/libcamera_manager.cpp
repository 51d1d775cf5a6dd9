// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/libcamera/libcamera_manager.hpp"

#include <fmt/format.h>
#include <libcamera/libcamera.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "common/error.hpp"
#include "common/log.hpp"
#include "daemon/capture/camera_stream.hpp"
#include "daemon/capture/libcamera/libcamera_controls.hpp"
#include "daemon/capture/libcamera/libcamera_formats.hpp"

namespace orbbuf {
namespace {

using libcamera::CameraManager;

/// Whether there is a manager, also while it is being destroyed.
struct Only {
  std::mutex mutex;
  std::condition_variable ended;
  std::weak_ptr<CameraManager> manager;
  bool is_alive = false;
};

Only& only() {
  static Only instance;
  return instance;
}

void destroy(const CameraManager* manager) {
  delete manager;
  const std::lock_guard lock(only().mutex);
  only().is_alive = false;
  only().ended.notify_all();
}

/// By the environment, since libcamera::logSetLevel() knows only categories that have been used.
void set_libcamera_log() {
  const char* const shown = is_logged(LogLevel::kTrace)   ? "*:DEBUG"
                            : is_logged(LogLevel::kDebug) ? "*:INFO"
                                                          : "*:WARN";
  ::setenv("LIBCAMERA_LOG_LEVELS", shown, 0);
  ::setenv("LIBCAMERA_LOG_NO_COLOR", "1", 0);  // of old releases; new ones colour terminals only
}

/// libcamera does not list cameras whose nodes it may not open, nor all of those that are in use.
/// Throws std::runtime_error, which begins with `text`, if some may not be opened, else CameraGone.
[[noreturn]] void fail_without_cameras(const std::string& text) {
  bool has_nodes = false;
  std::error_code ignored;  // a folder that is not there holds nothing
  for (const auto& entry : std::filesystem::directory_iterator("/dev", ignored)) {
    const auto name = entry.path().filename().string();
    const bool is_part = name.starts_with("media") || name.starts_with("video");
    has_nodes = has_nodes || is_part;
    if (is_part && ::access(entry.path().c_str(), R_OK | W_OK) != 0 && errno == EACCES) {
      throw std::runtime_error(
          fmt::format("{}; /dev/{}: Permission denied; add the user to group video", text, name));
    }
  }
  throw CameraGone(text + (has_nodes ? "; it may hide a camera that another program uses" : ""));
}

std::string ids_of(const std::vector<std::shared_ptr<libcamera::Camera>>& cameras) {
  std::vector<std::string> ids;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    ids.push_back(fmt::format("{}: {}", i, cameras[i]->id()));
  }
  return fmt::format("this machine has {}", fmt::join(ids, ", "));
}

std::string describe(libcamera::Camera& camera, std::size_t place) {
  std::string text = fmt::format("libcamera {}: {}, {}\n", place, camera.id(), model_of(camera));
  text += list_offers(offers_of(camera));
  for (const std::string& control : describe_controls(camera.controls())) {
    text += fmt::format("  control {}\n", control);
  }
  return text;
}

}  // namespace

std::shared_ptr<CameraManager> libcamera_manager() {
  std::unique_lock lock(only().mutex);
  while (only().is_alive) {
    if (auto manager = only().manager.lock()) return manager;
    only().ended.wait(lock);
  }
  set_libcamera_log();
  auto manager = std::make_unique<CameraManager>();
  if (const int status = manager->start(); status != 0) {
    throw std::runtime_error(system_error("cannot start libcamera", -status).text);
  }
  std::shared_ptr<CameraManager> shared(manager.release(), destroy);
  only().is_alive = true;
  only().manager = shared;
  return shared;
}

std::shared_ptr<libcamera::Camera> find_libcamera(CameraManager& manager,
                                                  const std::string& camera) {
  if (auto found = manager.get(camera)) return found;
  const auto cameras = manager.cameras();
  const bool is_place = !camera.empty() && camera.size() < 4 &&
                        camera.find_first_not_of("0123456789") == std::string::npos;
  if (is_place && std::stoul(camera) < cameras.size()) return cameras[std::stoul(camera)];
  const auto text = fmt::format("libcamera has no camera {}: ", camera);
  if (cameras.empty()) fail_without_cameras(text + "it found no camera that it can open");
  throw CameraGone(text + ids_of(cameras));
}

std::string list_libcamera() {
  const auto manager = libcamera_manager();
  const auto cameras = manager->cameras();
  std::string text;
  for (std::size_t i = 0; i < cameras.size(); ++i) text += describe(*cameras[i], i);
  return text;
}

}  // namespace orbbuf
