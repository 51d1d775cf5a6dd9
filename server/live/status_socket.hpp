// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <filesystem>
#include <string>

#include "common/error.hpp"
#include "server/live/metrics.hpp"

namespace orbbuf {

/// `status.socket` where the place is left to us.
inline constexpr const char* kAutomaticSocket = "auto";

/// Where a server of that `status.socket` listens; empty: nowhere. By itself in $RUNTIME_DIRECTORY,
/// which systemd sets, or else in $XDG_RUNTIME_DIR.
std::filesystem::path status_socket_path(const std::string& setting);

/// Sends each client the table of metrics, and closes. The socket is this user's alone. What
/// cannot be written at once is not written, so the server waits for no client. Thread-bound to
/// `main`. Must outlive every run of the io_context.
class StatusSocket {
 public:
  /// Listens; a socket that a server has left behind is replaced. Throws std::runtime_error, saying
  /// on what and why not, also if another server listens there. `metrics` must outlive it.
  StatusSocket(boost::asio::io_context& main, std::filesystem::path path, const Metrics& metrics);
  ~StatusSocket();
  StatusSocket(const StatusSocket&) = delete;
  StatusSocket& operator=(const StatusSocket&) = delete;

  void start() { accept(); }
  void stop();

 private:
  using Protocol = boost::asio::local::stream_protocol;

  static constexpr std::chrono::milliseconds kRetry{200};

  void accept();
  void accept_later();

  const std::filesystem::path path_;
  const Metrics& metrics_;
  Protocol::acceptor acceptor_;
  boost::asio::steady_timer retry_;
};

/// The table of the server that listens on `status.socket`; `auto`: of the one of this user, or
/// else the machine's service. An error that names what was tried. Blocking.
Result<std::string> ask_status(const std::string& setting);

/// The metrics for a terminal: a heading, and a line for each robot.
std::string to_table(const Metrics& metrics, RobotMetrics::Time now);

}  // namespace orbbuf
