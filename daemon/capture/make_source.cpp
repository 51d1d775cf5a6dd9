// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/make_source.hpp"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <stdexcept>

#include "daemon/capture/folder_replay_source.hpp"
#include "daemon/capture/nominal_time.hpp"
#include "daemon/capture/replay_source.hpp"
#include "daemon/capture/scene_source.hpp"
#include "daemon/capture/video_replay_source.hpp"

namespace orbbuf {
namespace {

using Settings = SourceSettings;
using Source = std::unique_ptr<FrameSource>;

struct Kind {
  std::string_view name;
  Source (*open)(const Settings&);
};

constexpr std::array kKinds = {
    Kind{"generated", [](const Settings& s) -> Source { return std::make_unique<SceneSource>(s); }},
    Kind{"folder",
         [](const Settings& s) -> Source { return std::make_unique<FolderReplaySource>(s); }},
    Kind{"video",
         [](const Settings& s) -> Source { return std::make_unique<VideoReplaySource>(s); }},
};
static_assert(std::ranges::equal(kKinds, kSourceKinds, {}, &Kind::name));

}  // namespace

std::unique_ptr<FrameSource> make_source(const SourceSettings& settings) {
  const auto* const kind = std::ranges::find(kKinds, settings.kind, &Kind::name);
  if (kind == kKinds.end()) {
    throw std::runtime_error(fmt::format("cannot open a source of kind '{}': the kinds are {}",
                                         settings.kind, fmt::join(kSourceKinds, ", ")));
  }
  if (!is_usable_fps(settings.fps)) {
    throw std::runtime_error(fmt::format("cannot open a source at {} fps: not from {} to {}",
                                         settings.fps, kMinFps, kMaxFps));
  }
  const ReplaySource::Options options{.is_realtime = settings.realtime,
                                      .is_looped = settings.loop,
                                      .nominal_interval_ns = nominal_time_ns(1, settings.fps)};
  return std::make_unique<ReplaySource>([kind, settings] { return kind->open(settings); }, options);
}

}  // namespace orbbuf
