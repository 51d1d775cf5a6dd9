// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "common/error.hpp"

namespace orbbuf {

/// `status.socket` where the place is left to us.
inline constexpr const char* kAutomaticSocket = "auto";

/// Where a server of that `status.socket` listens; empty: nowhere. By itself in $RUNTIME_DIRECTORY,
/// which systemd sets, or else in $XDG_RUNTIME_DIR.
std::filesystem::path control_socket_path(const std::string& setting);

/// Answers this user's commands to the server that runs: a client sends a word and a line end, gets
/// `ok`, a line end and the answer, or `error` and why, and the connection ends. Thread-bound to
/// `main`. Must outlive every run of the io_context.
class ControlSocket {
 public:
  /// Runs once, now or later. The text ends with a line end.
  using Answer = std::function<void(Result<std::string>)>;
  using Command = std::function<void(Answer)>;

  static constexpr std::size_t kMostClients = 16;  ///< further ones are not answered
  static constexpr std::chrono::seconds kWordTimeout{1};

  /// Listens, for this user alone; a socket that a server has left behind is replaced. Throws
  /// std::runtime_error, saying on what and why not, also if another server listens there.
  /// `commands`: by their words.
  ControlSocket(boost::asio::io_context& main, std::filesystem::path path,
                std::map<std::string, Command> commands);
  ~ControlSocket();
  ControlSocket(const ControlSocket&) = delete;
  ControlSocket& operator=(const ControlSocket&) = delete;

  void start() { accept(); }
  /// Clients that wait see the connection end.
  void stop();

 private:
  using Protocol = boost::asio::local::stream_protocol;
  struct Client;

  static constexpr std::chrono::milliseconds kRetry{200};

  void accept();
  void accept_later();
  void read_word(const std::shared_ptr<Client>& client);
  void run(const std::shared_ptr<Client>& client, const std::string& word);

  const std::filesystem::path path_;
  const std::map<std::string, Command> commands_;
  Protocol::acceptor acceptor_;
  boost::asio::steady_timer retry_;
  std::map<Client*, std::weak_ptr<Client>> clients_;
};

/// What the server of `status.socket` answers to `word`; `auto`: the one of this user, or else the
/// machine's service. An error that names what was tried, or is the server's. Blocking.
Result<std::string> ask_server(const std::string& setting, const std::string& word,
                               std::chrono::seconds patience);

}  // namespace orbbuf
