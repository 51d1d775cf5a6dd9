// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "server/session/session_info.hpp"
#include "server/sink/frame_sink.hpp"
#include "server/sink/pipe/child_process.hpp"
#include "server/sink/pipe/pipe_format.hpp"
#include "server/sink/pipe/pipe_sink.hpp"

namespace orbbuf {

/// Where a SLAM program begins when it was away while frames came.
enum class Resume : std::uint8_t {
  kLive,     ///< with the next one that comes
  kBacklog,  ///< with the first one that it missed
};

/// Which SLAM program reads a session live, through a FIFO or on its standard input. `{robot}` and
/// `{session}` in `fifo` and `command` stand for the session's ids.
struct SlamSettings {
  std::string command;         ///< empty: none
  std::filesystem::path fifo;  ///< empty: none; excludes `command`
  PipeFormat format = PipeFormat::kPgm;
  Restart restart = Restart::kAlways;  ///< of `command`
  Resume resume = Resume::kLive;

  bool is_on() const { return !command.empty() || !fifo.empty(); }

  friend bool operator==(const SlamSettings&, const SlamSettings&) = default;
};

/// The pipe to a session's SLAM program, which it begins to look for or starts. `kept`: what a sink
/// before this one keeps of the session, whose frames then pass the pipe by while it has no reader;
/// nothing: they wait. `main` and `pool` as in PipeSink.
std::shared_ptr<FrameSink> make_slam_sink(const SlamSettings& settings, const SessionInfo& info,
                                          const std::optional<KeptFrames>& kept,
                                          boost::asio::io_context& main,
                                          boost::asio::thread_pool& pool);

}  // namespace orbbuf
