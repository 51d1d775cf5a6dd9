// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "common/wire.hpp"
#include "server/runtime/group_commit.hpp"
#include "server/session/durability.hpp"
#include "server/session/session_info.hpp"
#include "server/session/session_stores.hpp"
#include "server/sink/dds/dds_sink.hpp"
#include "server/sink/frame_sink.hpp"
#include "server/sink/pipe/slam.hpp"
#include "server/sink/ros/ros_sink.hpp"

namespace orbbuf {

/// Which sinks a session gets.
struct SinkSettings {
  bool files_enabled = true;
  std::filesystem::path files_path = "orbbuf-data";  ///< of the recordings, too
  Durability files_sync = Durability::kAck;          ///< of the recordings, too
  bool mcap_enabled = false;
  std::chrono::nanoseconds mcap_split = std::chrono::minutes(5);  ///< of a part; 0: no limit
  SlamSettings slam;
  std::map<std::string, SlamSettings> slam_of;  ///< robot id -> its own, in place of `slam`
  RosSettings ros;
  DdsSettings dds;

  /// Whether sessions are kept on disk.
  bool is_kept() const { return files_enabled || mcap_enabled; }
  const SlamSettings& slam_for(const std::string& robot_id) const;

  friend bool operator==(const SinkSettings&, const SinkSettings&) = default;
};

/// For the start: throws std::runtime_error if the folder for files cannot be made or written to.
/// Warns if it is on a file system that may not keep what is synced.
void check_sinks(const SinkSettings& settings);

/// What sinks share begins: DDS, if it is enabled. Throws std::runtime_error. Before the first
/// make_sinks(); end_sinks() has to follow.
void begin_sinks(const SinkSettings& settings);

/// The syncs of those settings; null if there are none to do.
std::unique_ptr<GroupCommit> make_group_commit(const SinkSettings& settings,
                                               boost::asio::io_context& main);

/// A session as the disk has it; without a store it is not kept there.
using OpenedSession = SessionStores::Opened;

/// The sinks of an opened session, the one that keeps frames before the one that shows them.
/// `main` and `pool` as in SharedStore.
std::vector<std::shared_ptr<FrameSink>> make_sinks(const SinkSettings& settings,
                                                   const SessionInfo& info, OpenedSession opened,
                                                   boost::asio::io_context& main,
                                                   boost::asio::thread_pool& pool);

/// When serving is over and no sink is left: what they shared ends, in some seconds. False if it
/// does not; it may then still run, so no destructor of the process's may.
bool end_sinks(const SinkSettings& settings);

}  // namespace orbbuf
