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
#include <string>
#include <vector>

#include "bench/load/content.hpp"
#include "common/wire.hpp"

namespace orbbuf::load {

using Clock = std::chrono::steady_clock;

/// A robot's side of the link without its camera and policy: it captures by the clock, drops
/// nothing, keeps each frame until its ack, and sends its stats once a second. The clock is that
/// of the plan: a frame that this process is late to make is as old as if it had been in time.
///
/// Any fault throws std::runtime_error out of io_context::run(). Thread-bound, like its io_context,
/// which must not run any more once this is destroyed.
class Robot {
 public:
  struct Plan {
    std::size_t number = 0;
    std::uint64_t frames = 0;             ///< 0: only connected
    std::chrono::nanoseconds interval{};  ///< from frame to frame
  };

  Robot(boost::asio::io_context& io, const Content& content, Plan plan);

  /// Connects and says hello; `welcome` runs when the server has answered.
  void connect(const boost::asio::ip::tcp::endpoint& server, std::function<void()> welcome);
  /// Captures from `first` on and sends stats every second; `settled` runs when all frames
  /// are acknowledged, so not at all without frames.
  void start(Clock::time_point first, std::function<void()> settled);
  /// Says bye; `ended` runs when the server has. Requires that all is settled.
  void end(std::function<void()> ended);

  std::string id() const;
  static constexpr const char* kSession = "load";
  std::uint64_t captured() const { return captured_; }
  /// The most that this process was late to make a frame.
  std::chrono::nanoseconds most_late() const { return most_late_; }
  /// From each frame's capture to its ack, in the order of the acks.
  const std::vector<std::chrono::nanoseconds>& latencies() const { return latencies_; }
  /// The same to when the server said that it had received the frame.
  const std::vector<std::chrono::nanoseconds>& received_latencies() const {
    return received_latencies_;
  }

 private:
  struct Kept {
    FramePtr frame;
    Clock::time_point captured;
  };

  void capture_at(Clock::time_point due);
  std::chrono::seconds stats_interval() const;
  void stats_at(Clock::time_point due);
  wire::Stats stats() const;
  void say(std::vector<std::uint8_t> message);
  void write_next();
  void read();
  void take(const wire::Header& header);
  void take_ack(const wire::Ack& ack);
  /// Throws if `failed`.
  void check(const boost::system::error_code& failed, const char* attempt) const;

  const Content& content_;
  const Plan plan_;
  boost::asio::ip::tcp::socket socket_;
  boost::asio::steady_timer capture_timer_;
  boost::asio::steady_timer stats_timer_;
  std::function<void()> welcome_;
  std::function<void()> settled_;
  std::function<void()> ended_;

  std::uint64_t captured_ = 0;
  std::deque<Kept> kept_;     // captured, not acknowledged
  std::size_t sent_ = 0;      // how many of kept_ are written
  std::size_t received_ = 0;  // how many of kept_ the server has received
  std::vector<std::chrono::nanoseconds> latencies_;
  std::vector<std::chrono::nanoseconds> received_latencies_;
  std::chrono::nanoseconds most_late_{};

  bool is_writing_ = false;
  std::vector<std::uint8_t> waiting_;  // messages before the next frame
  std::vector<std::uint8_t> out_;
  std::array<std::uint8_t, wire::kHeaderBytes + wire::kFrameMetaBytes> head_{};
  FramePtr frame_;  // being written
  std::array<std::uint8_t, wire::kHeaderBytes> header_{};
  std::vector<std::uint8_t> body_;
};

}  // namespace orbbuf::load
