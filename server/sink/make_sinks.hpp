// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "server/recording/session_info.hpp"
#include "server/runtime/group_commit.hpp"
#include "server/sink/frame_sink.hpp"
#include "server/sink/pipe/slam.hpp"

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
  bool ros_enabled = false;                     ///< requires ORBBUF_ROS

  /// Whether sessions are kept on disk.
  bool is_kept() const { return files_enabled || mcap_enabled; }
  const SlamSettings& slam_for(const std::string& robot_id) const;

  friend bool operator==(const SinkSettings&, const SinkSettings&) = default;
};

/// For the start: throws std::runtime_error if the folder for files cannot be made or written to.
void check_sinks(const SinkSettings& settings);

/// The syncs of those settings; null if there are none to do.
std::unique_ptr<GroupCommit> make_group_commit(const SinkSettings& settings,
                                               boost::asio::io_context& main);

/// The sinks of a new or resumed session, those that keep frames before the one that shows them.
/// Reads what these hold (see SessionFiles::recover(), mcap::scan()), so it may block for as long
/// as that takes. An error if it cannot be read. `main`, `pool` and `commit` as in RecordSink.
Result<std::vector<std::shared_ptr<FrameSink>>> make_sinks(const SinkSettings& settings,
                                                           const SessionInfo& info,
                                                           boost::asio::io_context& main,
                                                           boost::asio::thread_pool& pool,
                                                           GroupCommit* commit = nullptr);

/// When serving is over and no sink is left: what they shared ends, within 1 s. False if it does
/// not; it may then still run, so no destructor of the process's may.
bool end_sinks(const SinkSettings& settings);

}  // namespace orbbuf
