// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "common/drop_record.hpp"
#include "common/wire.hpp"
#include "daemon/net/server_link.hpp"
#include "daemon/net/session_log.hpp"

namespace orbbuf {

/// Gives the server what it lacks of the records of earlier sessions, one after the other, over a
/// link that it has until it is done: their drop records, and the names of the frames that were
/// captured and reached neither the server nor the robot's own record. It says bye for a session
/// that ended in an orderly way.
///
/// A session that the server refuses, or of which it takes nothing for kPatience after its welcome,
/// stays in the robot's record for the next start. Thread-bound to `main`.
class EarlierSessions final : private ServerLink::Owner {
 public:
  static constexpr std::chrono::seconds kPatience{10};
  /// Of one session; 24 MB.
  static constexpr std::size_t kMostUnknown = 1U << 20;

  /// `link` must outlive it.
  EarlierSessions(boost::asio::io_context& io, ServerLink& link);

  /// `hello`: the present session's. Takes the link if there is a session of this robot; afterwards
  /// `done` runs. Without one `done` does not run.
  void start(const wire::Hello& hello, std::vector<EarlierSession> sessions,
             std::function<void()> done);
  /// Whether the link is taken.
  bool is_active() const { return done_ != nullptr; }
  /// Gives up the link; `done` does not run.
  void stop();

 private:
  void on_connected(const wire::Position& position) override;
  bool can_be_at(const wire::Position& /*position*/) const override { return true; }
  void on_disconnected() override {}
  void on_refused() override { leave("the server refuses it"); }
  void on_ack(const wire::Ack& ack) override;
  void on_bye(const wire::Position& position) override;
  void on_writable() override;

  const EarlierSession& session() const { return sessions_.back(); }
  void begin_session();
  void collect(const wire::Position& position);
  bool is_told(const wire::Position& position) const;
  void complete();
  void leave(const std::string& why);
  void go_on();

  ServerLink& link_;
  boost::asio::steady_timer patience_;
  wire::Hello hello_;
  std::vector<EarlierSession> sessions_;  // to be told, the next one last
  std::vector<DropRecord> records_;       // all of the session; empty before its first welcome
  bool is_collected_ = false;
  std::size_t sent_ = 0;  // of records_
  bool is_bye_sent_ = false;
  std::function<void()> done_;  // set: active
};

}  // namespace orbbuf
