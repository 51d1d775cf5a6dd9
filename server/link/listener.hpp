// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/log.hpp"
#include "server/link/connection.hpp"
#include "server/link/session.hpp"
#include "server/settings.hpp"
#include "server/sink/make_sinks.hpp"

namespace orbbuf {

using SessionKey = std::pair<std::string, std::string>;  ///< robot id, session id

/// The server: accepts connections and brings each together with its session.
///
/// Robots do not wait for each other: everything on `main` is one message at a time, and whatever
/// blocks is done elsewhere. A session is made when a robot asks for it, from what its files hold,
/// which the pool reads while the robot waits for its welcome; a robot that begins a new one ends
/// its old one, for good: else two robots with one id would replace each other again and again.
///
/// A host that connects and says nothing takes no robot's place: where there are as many
/// connections as there may be, one that serves no robot is ended for each that comes, the oldest
/// of the address that has the most of them.
///
/// Memory for one robot, at most: the kernel's receive buffer, twice the largest frame while one
/// comes, and as much again while a replaced connection's frame is still being written.
///
/// Thread-bound to `main`. Must outlive every run of the io_context.
class Listener final : public ConnectionOwner {
 public:
  /// Listens; accepts from start() on. Throws std::runtime_error, saying on what and why not, or
  /// which key or certificate cannot be used. `metrics`, null if there is no page, must outlive it.
  Listener(boost::asio::io_context& main, boost::asio::thread_pool& pool, Settings settings,
           Metrics* metrics = nullptr);

  boost::asio::ip::tcp::endpoint endpoint() const { return acceptor_.local_endpoint(); }

  /// Connections of robots that have said hello.
  std::size_t robots() const;

  /// Whether that session is open: a robot is connected to it, or may come back to it.
  bool has_session(const std::string& robot_id, const std::string& session_id) const;

  /// Whether its folder may still grow: it is open, or the robot still has frames of it.
  bool is_in_use(const std::string& robot_id, const std::string& folder) const;

  /// Before start(): runs at each failed try of a session's sink, a full disk for one.
  void on_sink_failed(std::function<void()> run) { sink_failed_ = std::move(run); }

  /// Closes the listening socket, so that a balancer knows first, ends the sessions as stop() does,
  /// and runs `drained` when no robot is here any more. From then on this server takes none.
  void drain(std::function<void()> drained);

  void start();
  /// Reads the certificates again, for the connections that follow. If they cannot be used, it logs
  /// why and keeps those that it has. Connections that are open stay open.
  void reload_tls();
  /// From here on only these may connect; empty: all. Connections of others end.
  void allow(std::vector<std::string> robots);
  /// Null: plain TCP.
  const std::shared_ptr<TlsContext>& tls() const { return tls_; }
  /// Null: no session is kept on disk.
  SessionStores* stores() override { return stores_ ? &*stores_ : nullptr; }
  /// Accepts no more, lets the sinks finish what they have begun (drain_timeout), says bye to the
  /// robots, and then runs `stopped`. Once.
  void stop(std::function<void()> stopped);

 private:
  static constexpr std::chrono::milliseconds kRetry{200};
  static constexpr std::chrono::seconds kLongestWait{1};

  struct Reopening {
    Reopening(SessionInfo asked, boost::asio::io_context& main)
        : info(std::move(asked)), limit(main) {}

    SessionInfo info;
    boost::asio::steady_timer limit;  // of the wait
  };

  void on_hello(const std::shared_ptr<Connection>& connection, const wire::Hello& hello) override;
  void on_closed(const std::shared_ptr<Connection>& connection) override;

  void accept();
  void beat();
  void on_accepted(boost::asio::ip::tcp::socket socket);
  std::string make_room(const boost::asio::ip::address& address);
  void on_accept_failed(const boost::system::error_code& failed);
  bool is_allowed(const std::string& robot_id) const;
  std::string reason_to_refuse(const SessionKey& key) const;
  void close_other_sessions(const SessionKey& key);
  bool wait_for(const SessionKey& key, const std::shared_ptr<Connection>& connection);
  bool has_device_failed() const;
  void step_aside();
  void end_sessions(SessionEnd end);
  bool is_empty() const;
  void on_session_closed(const SessionKey& key);
  void reopen_later(const SessionKey& key, const SessionInfo& info);
  void limit_wait(const SessionKey& key);
  void reopen(const SessionKey& key);
  std::shared_ptr<Connection> take_waiting(const SessionKey& key);
  void refuse(Connection& connection, const std::string& why);
  void open(const SessionKey& key, const SessionInfo& info);
  void on_opened(const SessionKey& key, SessionInfo info, const Result<OpenedSession>& opened);
  void check_empty();

  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  const Settings settings_;
  Metrics* const metrics_;
  const std::unique_ptr<GroupCommit> commit_;  // null: no syncs
  std::optional<SessionStores> stores_;
  std::shared_ptr<TlsContext> tls_;  // null: plain TCP
  boost::asio::ip::tcp::acceptor acceptor_;
  boost::asio::steady_timer retry_;
  boost::asio::steady_timer beat_;
  bool is_accept_failing_ = false;
  LogLimit crowding_{std::chrono::seconds{10}};
  std::vector<std::string> allowed_;                      // robots; empty: all
  std::vector<std::shared_ptr<Connection>> connections_;  // in the order in which they came
  /// The sessions that are not open yet: `pool` reads the disk, or an earlier one ends; and the
  /// newest connection that waits for each; null: none does any more.
  std::map<SessionKey, std::shared_ptr<Connection>> opening_;
  std::map<SessionKey, Reopening> reopening_;  // keys of opening_ of which an earlier one ends
  std::map<SessionKey, std::shared_ptr<Session>> sessions_;
  std::deque<SessionKey> superseded_;  // the last thousand
  std::string last_refusal_;           // logged already
  std::function<void()> sink_failed_;
  std::vector<std::function<void()>> drained_;  // those who wait
  std::function<void()> stopped_;               // set: stopping
};

}  // namespace orbbuf
