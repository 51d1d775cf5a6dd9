// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "common/wire.hpp"
#include "server/recording/session_info.hpp"
#include "server/runtime/group_commit.hpp"
#include "server/sink/frame_sink.hpp"
#include "server/sink/pipe/slam.hpp"
#include "server/sink/record_sink.hpp"
#include "server/sink/ros/ros_sink.hpp"

namespace orbbuf {

/// When what was written to files and recordings is brought onto the device.
enum class FilesSync : std::uint8_t {
  kAck,     ///< before it is acknowledged
  kSecond,  ///< within a second or so
  kOff,     ///< when the kernel does it
};

/// Which sinks a session gets.
struct SinkSettings {
  bool files_enabled = true;
  std::filesystem::path files_path = "orbbuf-data";  ///< of the recordings, too
  FilesSync files_sync = FilesSync::kAck;            ///< of the recordings, too
  bool mcap_enabled = false;
  SlamSettings slam;
  std::map<std::string, SlamSettings> slam_of;  ///< robot id -> its own, in place of `slam`
  RosSettings ros;
  bool dds_enabled = false;              ///< requires ORBBUF_DDS
  std::string dds_frame_id = "{robot}";  ///< see ros_frame_id()

  /// Whether sessions are kept on disk.
  bool is_kept() const { return files_enabled || mcap_enabled; }
  const SlamSettings& slam_for(const std::string& robot_id) const;

  friend bool operator==(const SinkSettings&, const SinkSettings&) = default;
};

/// For the start: throws std::runtime_error if the folder for files cannot be made or written to.
void check_sinks(const SinkSettings& settings);

/// What sinks share begins: DDS, if it is enabled. Throws std::runtime_error. Before the first
/// make_sinks(); end_sinks() has to follow.
void begin_sinks(const SinkSettings& settings);

/// The syncs of those settings; null if there are none to do.
std::unique_ptr<GroupCommit> make_group_commit(const SinkSettings& settings,
                                               boost::asio::io_context& main);

/// A session as the disk has it.
struct OpenedSession {
  RecordSink::Records records;  ///< empty: it is not kept there
  wire::Position position;
  std::optional<KeptFrames> kept;
};

/// Opens a new or resumed session: reads and repairs what the disk holds of it (see
/// SessionFiles::recover(), mcap::Recording::recover()). An error if that cannot be read. Blocking:
/// up to a second for 300,000 frames, longer on a cold disk. Reentrant for different sessions.
Result<OpenedSession> open_session(const SinkSettings& settings, const SessionInfo& info);

/// The sinks of an opened session, those that keep frames before the one that shows them. `main`,
/// `pool` and `commit` as in RecordSink.
std::vector<std::shared_ptr<FrameSink>> make_sinks(const SinkSettings& settings,
                                                   const SessionInfo& info, OpenedSession opened,
                                                   boost::asio::io_context& main,
                                                   boost::asio::thread_pool& pool,
                                                   GroupCommit* commit = nullptr);

/// When serving is over and no sink is left: what they shared ends, in some seconds. False if it
/// does not; it may then still run, so no destructor of the process's may.
bool end_sinks(const SinkSettings& settings);

}  // namespace orbbuf
