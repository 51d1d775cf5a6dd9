// SPDX-License-Identifier: Apache-2.0
#include "server/sink/make_sinks.hpp"

#include <fmt/core.h>
#include <unistd.h>

#include <cerrno>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "common/log.hpp"
#include "server/sink/record_sink.hpp"

namespace orbbuf {
namespace asio = boost::asio;

/// Frames of many robots that come within this time share a sync.
constexpr std::chrono::milliseconds kAckInterval{20};
constexpr std::chrono::milliseconds kSecondInterval{1000};

const SlamSettings& SinkSettings::slam_for(const std::string& robot_id) const {
  const auto own = slam_of.find(robot_id);
  return own == slam_of.end() ? slam : own->second;
}

void check_sinks(const SinkSettings& settings) {
  if (!settings.is_kept()) return;
  const auto& path = settings.files_path;
  std::error_code failed;
  std::filesystem::create_directories(path, failed);
  if (!failed && ::access(path.c_str(), R_OK | W_OK | X_OK) != 0) {
    failed = {errno, std::generic_category()};
  }
  if (failed) {
    throw std::runtime_error(
        fmt::format("cannot write to files.path {}: {}; give user {} the right to (chown), or set "
                    "another files.path",
                    path.string(), failed.message(), ::geteuid()));
  }
  const auto weak = weak_file_system(settings.files_path);
  if (!weak || settings.files_sync == Durability::kOff) return;
  log_warn("files.path {} is on a {} file system, which may not keep what is synced: {}",
           settings.files_path.string(), *weak,
           settings.files_sync == Durability::kAck
               ? "each frame is synced by itself, which is slow"
               : "a power cut may lose more than the last second");
}

std::unique_ptr<GroupCommit> make_group_commit(const SinkSettings& settings,
                                               asio::io_context& main) {
  if (!settings.is_kept() || settings.files_sync == Durability::kOff) return nullptr;
  const bool is_ack = settings.files_sync == Durability::kAck;
  return std::make_unique<GroupCommit>(main, settings.files_path,
                                       is_ack ? kAckInterval : kSecondInterval,
                                       is_ack ? "frames are not acknowledged any more"
                                              : "frames are acknowledged and not synced any more, "
                                                "and a power cut may lose them");
}

std::vector<std::shared_ptr<FrameSink>> make_sinks(const SinkSettings& settings,
                                                   const SessionInfo& info, OpenedSession opened,
                                                   asio::io_context& main,
                                                   asio::thread_pool& pool) {
  std::vector<std::shared_ptr<FrameSink>> sinks;
  std::optional<KeptFrames> kept;
  [[maybe_unused]] std::filesystem::path folder;
  if (opened.store) {
    folder = opened.store->folder();
    kept.emplace();
    if (settings.files_enabled) {
      *kept = {opened.store->folder(), opened.position[wire::kFrames]};
    }
    sinks.push_back(std::make_shared<RecordSink>(std::move(opened.store), opened.position));
  }
  const SlamSettings& slam = settings.slam_for(info.robot_id);
  if (slam.is_on()) sinks.push_back(make_slam_sink(slam, info, kept, main, pool));
#ifdef ORBBUF_DDS
  if (settings.dds.enabled) {
    sinks.push_back(make_dds_sink(main, info, settings.dds, {folder, opened.position}));
  }
#endif
#ifdef ORBBUF_ROS
  if (settings.ros.enabled) sinks.push_back(make_ros_sink(main, info, settings.ros));
#endif
  return sinks;
}

void begin_sinks([[maybe_unused]] const SinkSettings& settings) {
#ifdef ORBBUF_DDS
  if (settings.dds.enabled) begin_dds();
#endif
}

bool end_sinks([[maybe_unused]] const SinkSettings& settings) {
#ifdef ORBBUF_DDS
  end_dds();
#endif
#ifdef ORBBUF_ROS
  if (settings.ros.enabled) return end_ros();
#endif
  return true;
}

}  // namespace orbbuf
