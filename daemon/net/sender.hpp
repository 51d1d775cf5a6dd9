// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/drop_record.hpp"
#include "common/wire.hpp"
#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/net/drop_log.hpp"
#include "daemon/net/link_rate.hpp"
#include "daemon/net/reporter.hpp"
#include "daemon/net/server_link.hpp"

namespace orbbuf {

/// Chooses what goes to the server next: frames of the buffer, drop records, reports, and bye.
///
/// The next message is chosen when the kernel has nearly nothing left to send (paper, Sec. III-E:
/// transmission of a message begins when the last is complete). A frame is chosen only while less
/// than a window is written and not acknowledged: 2 frames, or what link and server take in two
/// round trips and 100 ms, whichever is more. So a slow SLAM program leaves the choice to the
/// policy, and a server that never acknowledges cannot make the robot hold more. Other messages are
/// not bound by the window. Every frame stays in the buffer's account until the server has
/// acknowledged it; every drop record is sent until acknowledged.
///
/// | state     | what is sent                      | the next state, and when |
/// |-----------|-----------------------------------|------------------------------------------------|
/// | kSending  | frames, drop records, reports     | kDraining: finish() | | kDraining | the same;
/// bye, once everything    | kEnded: the server answers the bye             | |           | is
/// acknowledged                   | kLeaving: drain_timeout, while connected       | |           |
/// | kEnded: drain_timeout, without a connection    | | kLeaving  | the same; the frames that
/// waited  | kEnded: the server answers the bye, or after   | |           | were given up by name
/// | 2 s                                            | | kEnded    | nothing | |
///
/// Thread-bound to `main`, the thread that runs the io_context.
class Sender final : private ServerLink::Owner {
 public:
  /// `buffer` and `drops` must outlive the sender. Nothing happens before start(). Throws
  /// std::runtime_error if the keys of settings.tls cannot be used.
  Sender(boost::asio::io_context& io, const LinkSettings& settings, wire::Hello hello,
         FrameBuffer& buffer, DropLog& drops);

  void start();

  /// There may be something new to send.
  void wake();

  const ServerLink& link() const { return link_; }

  /// No more frames will come: delivers what waits, for at most drain_timeout, gives up the rest by
  /// name, and says bye. Then `done` is called, with true if the server has the whole record.
  void finish(std::function<void(bool complete)> done);

 private:
  enum class State : std::uint8_t { kSending, kDraining, kLeaving, kEnded };

  void on_connected(const wire::Position& position) override;
  void on_disconnected() override;
  void on_ack(const wire::Position& position) override;
  void on_bye(const wire::Position& position) override;
  void on_writable() override;

  void write_next();
  FramePtr choose_frame();
  bool is_window_open() const;
  void collect_drops();
  bool is_settled() const;
  void report_each_second();
  std::vector<std::uint8_t> next_report();
  void say_bye();
  void leave();
  void end(bool complete);

  FrameBuffer& buffer_;
  DropLog& drops_;
  std::vector<DropRecord> collected_;  // on their way from buffer_ to drops_
  const std::chrono::nanoseconds drain_timeout_;

  ServerLink link_;
  LinkRate rate_;
  std::chrono::nanoseconds min_round_trip_{0};  // the last connection's

  State state_ = State::kSending;
  boost::asio::steady_timer state_timer_;  // until the end of kDraining or kLeaving
  std::function<void(bool)> done_;

  Reporter reporter_;
  boost::asio::steady_timer report_timer_;
  bool is_drops_turn_ = false;
  bool is_bye_sent_ = false;  // to the present connection
};

}  // namespace orbbuf
