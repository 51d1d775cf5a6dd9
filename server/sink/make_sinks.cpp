// SPDX-License-Identifier: Apache-2.0
#include "server/sink/make_sinks.hpp"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <chrono>
#include <optional>
#include <system_error>
#include <utility>

#include "server/recording/mcap/recording.hpp"
#include "server/recording/session_files.hpp"
#include "server/recording/session_names.hpp"
#include "server/sink/record_sink.hpp"
#ifdef ORBBUF_DDS
#include "server/sink/dds/dds_sink.hpp"
#endif

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
  std::error_code ignored;  // access() says why
  std::filesystem::create_directories(settings.files_path, ignored);
  if (::access(settings.files_path.c_str(), W_OK | X_OK) != 0) {
    throw_system_error("write files to " + settings.files_path.string());
  }
}

std::unique_ptr<GroupCommit> make_group_commit(const SinkSettings& settings,
                                               asio::io_context& main) {
  if (!settings.is_kept() || settings.files_sync == FilesSync::kOff) return nullptr;
  const bool is_ack = settings.files_sync == FilesSync::kAck;
  return std::make_unique<GroupCommit>(main, settings.files_path,
                                       is_ack ? kAckInterval : kSecondInterval,
                                       is_ack ? "frames are not acknowledged any more"
                                              : "frames are acknowledged and not synced any more, "
                                                "and a power cut may lose them");
}

/// The recording is written before the files, for mcap::Recording::recover() relies on it: what it
/// has beyond them was never acknowledged. Where there are files their position is the session's:
/// the robot is asked again for what they lack, even if the recording has it.
Result<OpenedSession> open_session(const SinkSettings& settings, const SessionInfo& info) {
  const auto folder = settings.files_path / info.robot_id / info.folder();
  OpenedSession opened;
  std::unique_ptr<SessionFiles> files;
  std::optional<wire::Position> of_files;
  if (settings.files_enabled) {
    files = std::make_unique<SessionFiles>(folder, info.calibration, info.segment);
    auto position = files->recover();
    if (!position) return std::move(position).error();
    of_files = opened.position = position.value();
    opened.kept = KeptFrames{folder, of_files->next_sequence};
  }
  if (settings.mcap_enabled) {
    auto recording =
        std::make_unique<mcap::Recording>(folder / session_names::recording(info.session_id), info);
    auto position = recording->recover(of_files);
    if (!position) return std::move(position).error();
    if (!files) {
      opened.position = position.value();
      opened.kept = KeptFrames{};
    } else if (const auto error = recording->take_missed(folder, opened.position)) {
      spdlog::warn("{} {}: not recorded: {}", info.robot_id, info.session_id, error->text);
    }
    opened.records.push_back(std::move(recording));
  }
  if (files) opened.records.push_back(std::move(files));
  return opened;
}

std::vector<std::shared_ptr<FrameSink>> make_sinks(const SinkSettings& settings,
                                                   const SessionInfo& info, OpenedSession opened,
                                                   asio::io_context& main, asio::thread_pool& pool,
                                                   GroupCommit* commit) {
  std::vector<std::shared_ptr<FrameSink>> sinks;
  if (!opened.records.empty()) {
    sinks.push_back(std::make_shared<RecordSink>(
        main, pool, std::move(opened.records), opened.position,
        RecordSink::Commit{commit, settings.files_sync == FilesSync::kAck}));
  }
  const SlamSettings& slam = settings.slam_for(info.robot_id);
  if (slam.is_on()) sinks.push_back(make_slam_sink(slam, info, opened.kept, main, pool));
#ifdef ORBBUF_DDS
  if (settings.dds_enabled) sinks.push_back(make_dds_sink(main, info, settings.dds_frame_id));
#endif
#ifdef ORBBUF_ROS
  if (settings.ros.enabled) sinks.push_back(make_ros_sink(main, info, settings.ros));
#endif
  return sinks;
}

void begin_sinks([[maybe_unused]] const SinkSettings& settings) {
#ifdef ORBBUF_DDS
  if (settings.dds_enabled) begin_dds();
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
