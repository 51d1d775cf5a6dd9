// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "common/error.hpp"

namespace orbbuf::fleet {

/// Where `orbbuf-server drain` asks this server to send its robots away. Who connects asks, and
/// is answered by a line when that is over. Thread-bound to `main`; must outlive every run of the
/// io_context.
class DrainSocket {
 public:
  using Done = std::function<void(const std::optional<Error>&)>;

  /// Listens at `path`, for this user alone. Throws std::runtime_error. drain: called once, until
  /// it has failed.
  DrainSocket(boost::asio::io_context& main, std::filesystem::path path,
              std::function<void(Done)> drain);
  ~DrainSocket();
  DrainSocket(const DrainSocket&) = delete;
  DrainSocket& operator=(const DrainSocket&) = delete;

  void start() { accept(); }
  void stop();

 private:
  using Protocol = boost::asio::local::stream_protocol;

  void accept();
  void on_drained(const std::optional<Error>& error);

  const std::filesystem::path path_;
  const std::function<void(Done)> drain_;
  Protocol::acceptor acceptor_;
  std::vector<std::unique_ptr<Protocol::socket>> waiting_;
  bool is_draining_ = false;
  bool is_drained_ = false;
};

/// Beside the status socket.
std::filesystem::path drain_socket_of(const std::filesystem::path& status_socket);

/// Asks the server behind `path` and waits. Blocking.
std::optional<Error> ask_drain(const std::filesystem::path& path, std::chrono::seconds patience);

}  // namespace orbbuf::fleet
