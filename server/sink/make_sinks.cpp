// SPDX-License-Identifier: Apache-2.0
#include "server/sink/make_sinks.hpp"

#include <unistd.h>

#include <optional>
#include <system_error>
#include <utility>

#include "server/sink/file_sink.hpp"
#include "server/sink/mcap_recording.hpp"
#include "server/sink/session_files.hpp"
#include "server/sink/session_names.hpp"
#ifdef ORBBUF_ROS
#include "server/sink/ros_sink.hpp"
#endif

namespace orbbuf {
namespace asio = boost::asio;

const SlamSettings& SinkSettings::slam_for(const std::string& robot_id) const {
  const auto own = slam_of.find(robot_id);
  return own == slam_of.end() ? slam : own->second;
}

namespace {

/// The recording before the files: McapRecording::recover() relies on it.
std::optional<Error> add_records(const SinkSettings& settings, const SessionInfo& info,
                                 asio::io_context& main, asio::thread_pool& pool,
                                 std::vector<std::shared_ptr<FrameSink>>& sinks,
                                 std::optional<KeptFrames>& kept) {
  const auto folder = settings.files_path / info.robot_id / info.session_id;
  std::shared_ptr<FrameSink> files_sink;
  std::optional<wire::Position> held;
  if (settings.files_enabled) {
    auto files = std::make_unique<SessionFiles>(folder, info.calibration);
    auto position = files->recover();
    if (!position) return std::move(position).error();
    held = position.value();
    kept = KeptFrames{folder, held->next_sequence};
    files_sink = std::make_shared<FileSink>(main, pool, std::move(files), *held);
  }
  if (settings.mcap_enabled) {
    auto recording =
        std::make_unique<McapRecording>(folder / session_names::recording(info.session_id), info);
    auto position = recording->recover(held);
    if (!position) return std::move(position).error();
    if (!kept) kept = KeptFrames{};
    sinks.push_back(std::make_shared<FileSink>(main, pool, std::move(recording), position.value()));
  }
  if (files_sink) sinks.push_back(std::move(files_sink));
  return std::nullopt;
}

}  // namespace

void check_sinks(const SinkSettings& settings) {
  if (!settings.files_enabled && !settings.mcap_enabled) return;
  std::error_code ignored;  // access() says why
  std::filesystem::create_directories(settings.files_path, ignored);
  if (::access(settings.files_path.c_str(), W_OK | X_OK) != 0) {
    throw_system_error("write files to " + settings.files_path.string());
  }
}

Result<std::vector<std::shared_ptr<FrameSink>>> make_sinks(const SinkSettings& settings,
                                                           const SessionInfo& info,
                                                           asio::io_context& main,
                                                           asio::thread_pool& pool) {
  std::vector<std::shared_ptr<FrameSink>> sinks;
  std::optional<KeptFrames> kept;
  if (auto error = add_records(settings, info, main, pool, sinks, kept)) return std::move(*error);
  const SlamSettings& slam = settings.slam_for(info.robot_id);
  if (slam.is_on()) sinks.push_back(make_slam_sink(slam, info, kept, main, pool));
#ifdef ORBBUF_ROS
  if (settings.ros_enabled) sinks.push_back(make_ros_sink(main, info));
#endif
  return sinks;
}

bool end_sinks([[maybe_unused]] const SinkSettings& settings) {
#ifdef ORBBUF_ROS
  if (settings.ros_enabled) return end_ros();
#endif
  return true;
}

}  // namespace orbbuf
