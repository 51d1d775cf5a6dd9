// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/make_source.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "daemon/capture/camera_source.hpp"
#include "daemon/capture/replay/folder_replay_source.hpp"
#include "daemon/capture/replay/replay_frame.hpp"
#include "daemon/capture/replay/replay_source.hpp"
#include "daemon/capture/replay/scene_source.hpp"
#include "daemon/capture/stereo/side_by_side_source.hpp"
#include "daemon/capture/stereo/stereo_source.hpp"
#ifdef ORBBUF_IMAGE_FILES
#include "daemon/capture/replay/video_replay_source.hpp"
#endif
#ifdef ORBBUF_LIBCAMERA
#include "daemon/capture/libcamera/libcamera_stream.hpp"
#endif
#ifdef ORBBUF_DAEMON_DDS
#include "daemon/capture/ros2/ros2_source.hpp"
#endif
#ifdef ORBBUF_V4L2
#include "daemon/capture/v4l2/v4l2_stream.hpp"
#endif

namespace orbbuf {
namespace {

using Settings = SourceSettings;
using Source = std::unique_ptr<FrameSource>;

struct Kind {
  std::string_view name;
  bool is_camera;
  Source (*open)(const Settings&);
};

#ifdef ORBBUF_V4L2
std::unique_ptr<CameraSource> open_v4l2_camera(const Settings& settings) {
  return std::make_unique<CameraSource>([settings] { return open_v4l2_stream(settings); },
                                        settings.device, settings.fps);
}
#endif

Source open_video([[maybe_unused]] const Settings& settings) {
#ifdef ORBBUF_IMAGE_FILES
  return std::make_unique<VideoReplaySource>(settings);
#else
  throw std::runtime_error("cannot replay a video: orbbufd was built without OpenCV's videoio");
#endif
}

Source open_v4l2([[maybe_unused]] const Settings& settings) {
#ifdef ORBBUF_V4L2
  auto left = open_v4l2_camera(settings);
  if (settings.device_right.empty()) return left;
  Settings settings_right = settings;
  settings_right.device = settings.device_right;
  auto right = open_v4l2_camera(settings_right);
  const auto frame_time = std::min(left->frame_time(), right->frame_time());
  return std::make_unique<StereoSource>(std::move(left), std::move(right), frame_time / 2);
#else
  throw std::runtime_error("cannot open a V4L2 camera: orbbufd was built without V4L2");
#endif
}

Source open_libcamera([[maybe_unused]] const Settings& settings) {
#ifdef ORBBUF_LIBCAMERA
  return std::make_unique<CameraSource>([settings] { return open_libcamera_stream(settings); },
                                        settings.camera, settings.fps);
#else
  throw std::runtime_error("cannot open a libcamera camera: orbbufd was built without libcamera");
#endif
}

Source open_ros2([[maybe_unused]] const Settings& settings) {
#ifdef ORBBUF_DAEMON_DDS
  auto left = std::make_unique<Ros2Source>(settings.topic, settings.color);
  if (settings.topic_right.empty()) return left;
  auto right = std::make_unique<Ros2Source>(settings.topic_right, settings.color);
  const std::chrono::nanoseconds frame_time(nominal_time_ns(1, settings.fps));
  return std::make_unique<StereoSource>(std::move(left), std::move(right), frame_time / 2);
#else
  throw std::runtime_error(
      "cannot read a ROS 2 topic: orbbufd was built without DDS (cmake -DORBBUF_WITH_DDS=ON)");
#endif
}

constexpr std::array kKinds = {
    Kind{"generated", false,
         [](const Settings& s) -> Source { return std::make_unique<SceneSource>(s); }},
    Kind{"folder", false,
         [](const Settings& s) -> Source { return std::make_unique<FolderReplaySource>(s); }},
    Kind{"video", false, open_video},
    Kind{"v4l2", true, open_v4l2},
    Kind{"libcamera", true, open_libcamera},
    Kind{"ros2", true, open_ros2},
};
static_assert(std::ranges::equal(kKinds, kSourceKinds, {}, &Kind::name));

Source open(const Kind& kind, const Settings& settings) {
  auto source = kind.open(settings);
  if (!settings.is_side_by_side) return source;
  return std::make_unique<SideBySideSource>(std::move(source));
}

}  // namespace

std::unique_ptr<FrameSource> make_source(const SourceSettings& settings) {
  const auto* const kind = std::ranges::find(kKinds, settings.kind, &Kind::name);
  if (kind == kKinds.end()) {
    throw std::runtime_error(fmt::format("cannot open a source of kind '{}': the kinds are {}",
                                         settings.kind, fmt::join(kSourceKinds, ", ")));
  }
  if (!is_usable_fps(settings.fps)) {
    throw std::runtime_error(fmt::format("cannot open a source at {} fps: must be {} to {}",
                                         settings.fps, kMinFps, kMaxFps));
  }
  if (kind->is_camera) return open(*kind, settings);
  const ReplaySource::Options options{.is_realtime = settings.realtime,
                                      .is_looped = settings.loop,
                                      .is_like_camera = settings.kind == "generated",
                                      .nominal_interval_ns = nominal_time_ns(1, settings.fps)};
  return std::make_unique<ReplaySource>([kind, settings] { return open(*kind, settings); },
                                        options);
}

}  // namespace orbbuf
