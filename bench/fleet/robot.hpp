// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bench/load/content.hpp"
#include "common/wire.hpp"

namespace orbbuf::fleet_bench {

using Clock = std::chrono::steady_clock;

/// A robot that knows several servers, without its camera and policy: it drops nothing, keeps each
/// frame until its ack, comes again when its connection breaks, goes to the next server when its
/// own is silent or gone, or to the one that it is told. It leaves the connections before open and
/// listens to them: what a server acknowledges there beyond the position at which its successor has
/// begun is a split brain.
///
/// Thread-bound to its io_context, which must not run any more once this is destroyed.
class Robot {
 public:
  struct Plan {
    std::size_t number = 0;
    std::chrono::nanoseconds interval{};  ///< from frame to frame
    std::vector<boost::asio::ip::tcp::endpoint> servers;
  };
  struct Counts {
    std::uint64_t captured = 0;
    std::uint64_t split_brain = 0;  ///< acks beyond a successor's beginning
    std::uint64_t forgotten = 0;    ///< acknowledged frames that a later welcome did not know
    std::vector<double> gaps_s;     ///< from the last ack of a server to its successor's welcome
    std::vector<double> acks_s;     ///< from capture to ack
  };

  Robot(boost::asio::io_context& io, const load::Content& content, Plan plan);

  void start(Clock::time_point first);
  /// Captures no more; `ended` when all is acknowledged and a server has said bye.
  void end(std::function<void()> ended);
  /// Its connection breaks.
  void cut();

  std::string id() const { return "robot-" + std::to_string(plan_.number); }
  static constexpr const char* kSession = "s";
  const Counts& counts() const { return counts_; }
  void forget_gaps() { counts_.gaps_s.clear(); }
  std::size_t server() const { return server_; }
  /// For people: why it does not end.
  std::string state() const;

 private:
  struct Link;
  struct Kept {
    FramePtr frame;
    Clock::time_point captured;
  };

  void capture_at(Clock::time_point due);
  void watch();
  void attempt(const boost::asio::ip::tcp::endpoint& server);
  void attempt_next();
  void attempt_later();
  void read(const std::shared_ptr<Link>& link);
  void take(const std::shared_ptr<Link>& link, const wire::Header& header);
  void take_welcome(const std::shared_ptr<Link>& link, const wire::Welcome& welcome);
  void take_ack(const std::shared_ptr<Link>& link, const wire::Ack& ack);
  void take_error(const std::shared_ptr<Link>& link, const wire::ErrorMessage& error);
  void on_lost(const std::shared_ptr<Link>& link);
  void write_next();
  void confirm(Sequence next);

  boost::asio::io_context& io_;
  const load::Content& content_;
  const Plan plan_;
  boost::asio::steady_timer capture_timer_;
  boost::asio::steady_timer watch_timer_;
  boost::asio::steady_timer retry_timer_;
  std::shared_ptr<Link> link_;     // welcomed
  std::shared_ptr<Link> attempt_;  // not yet
  std::vector<std::weak_ptr<Link>> former_;
  std::size_t server_ = 0;
  std::optional<std::size_t> sent_by_;  // of the attempt; it is asked again if that fails
  std::size_t last_server_ = SIZE_MAX;  // that welcomed
  Clock::time_point heard_{};
  Clock::time_point attempt_begun_{};

  std::deque<Kept> kept_;  // not acknowledged
  Sequence confirmed_ = 0;
  Sequence received_ = 0;
  std::size_t sent_ = 0;  // of kept_
  bool is_capturing_ = true;
  bool is_over_ = false;
  std::function<void()> ended_;
  Counts counts_;
};

}  // namespace orbbuf::fleet_bench
