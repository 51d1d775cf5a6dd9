// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "bench/powercut/content.hpp"
#include "common/wire.hpp"
#include "testing/robot_client.hpp"

namespace orbbuf::powercut {

using Clock = std::chrono::steady_clock;

/// One robot of the load, which remembers what was acknowledged when. One thread at a time.
class Robot {
 public:
  Robot(int number, std::string session)
      : number_(number), session_(std::move(session)), content_(number) {}

  std::string name() const { return "r" + std::to_string(number_); }
  const std::string& session() const { return session_; }
  const Content& content() const { return content_; }
  /// Behind the last step of which something was sent.
  Sequence end() const { return end_; }
  /// What was acknowledged by then, in the first connection: so of late ones as well.
  wire::Position acknowledged_by(Clock::time_point time) const;

  /// Sends step after step until `has_ended`, or until the server is gone.
  void run(std::uint16_t port, const std::atomic<bool>& has_ended);
  /// Sends all that the server lacks of these steps, what was not acknowledged of late ones, and
  /// bye. The welcome's position.
  std::optional<wire::Position> finish(std::uint16_t port);

 private:
  std::optional<wire::Position> hello(const test::RobotClient& link) const;
  void send(const test::RobotClient& link, Sequence step, const wire::Position& from) const;
  void send(const test::RobotClient& link, const Content::Late& late, std::uint64_t number) const;
  void send_account(const test::RobotClient& link, std::uint64_t number, bool is_held) const;
  bool read_acks(const test::RobotClient& link, int milliseconds);

  const int number_;
  const std::string session_;
  const Content content_;
  struct Ack {
    Clock::time_point time;
    wire::Position position;
  };
  std::vector<Ack> acks_;
  Sequence end_ = 0;
};

}  // namespace orbbuf::powercut
