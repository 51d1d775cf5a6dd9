// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/unique_fd.hpp"
#include "common/wire.hpp"

namespace orbbuf::test {

/// A robot's side of the link, each step of which a test writes out, over a real loopback socket.
/// Calls block; a server that stays silent for 30 s counts as having closed the connection.
class RobotClient {
 public:
  explicit RobotClient(std::uint16_t port, UniqueFd socket = tcp_socket());
  static UniqueFd tcp_socket();

  void send(std::span<const std::uint8_t> bytes) const;
  void send_text(std::string_view text) const;
  void send_frame(const EncodedFrame& frame) const;
  /// Numbered from `first` on.
  void send_drops(std::uint64_t first, const std::vector<DropRecord>& records) const;
  void send_late(std::uint64_t number, const std::string& session, const EncodedFrame& frame) const;
  /// What wire::encode_late_record() has made.
  void send_late(std::uint64_t number, std::span<const std::uint8_t> record) const;
  void send_account(std::uint64_t number, const wire::Account& account) const;
  void send_hello(const std::string& robot, const std::string& session) const;
  /// Says hello and returns where the welcome puts the robot; nothing if there was none.
  std::optional<wire::Position> hello(const std::string& robot, const std::string& session) const;

  /// Reads the next message if it is of that kind. Acks are passed over where another one is asked
  /// for, and where the server only repeats itself, for two seconds at most.
  std::optional<wire::Position> welcome() const;
  std::optional<wire::Position> ack() const;
  std::optional<wire::Ack> whole_ack() const;
  std::optional<wire::Position> bye() const;
  std::optional<wire::ErrorMessage> error() const;
  /// Reads acks until one covers `next` items of that stream. False if something else comes.
  bool acked(std::uint64_t next, wire::StreamId stream = wire::kFrames) const;

  /// True when the server has closed its side and nothing is left to read.
  bool is_closed() const;
  /// Closes the socket at once; with a reset if `abruptly`.
  void close(bool abruptly = false);
  int fd() const { return socket_.get(); }

 private:
  struct Message {
    wire::Header header;
    std::vector<std::uint8_t> body;
  };
  std::optional<Message> read(wire::Type type) const;
  std::optional<Message> read() const;
  bool read_exactly(std::span<std::uint8_t> bytes) const;

  UniqueFd socket_;
  mutable wire::Ack last_;  // that the server said
};

}  // namespace orbbuf::test
