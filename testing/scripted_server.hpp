// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/wire.hpp"

namespace orbbuf::test {

/// One message as it came, its header checked.
struct Message {
  wire::Header header;
  std::vector<std::uint8_t> body;

  wire::Type type() const { return header.type; }
  EncodedFrame frame() const;
  wire::Items items() const;
};

/// Drop records as they came, the first of them with its number.
struct NumberedDrops {
  std::uint64_t first = 0;
  std::vector<DropRecord> records;
};

/// That of a server that takes frames and drop records.
wire::Welcome welcome_at(const wire::Position& position);

/// A server's side of the link, each step of which a test writes out, over a real loopback socket.
/// Every call blocks until it is done; ctest's time-out guards against a peer that stays silent.
class ScriptedServer {
 public:
  ScriptedServer();

  std::uint16_t port() const;

  /// Takes the next connection in place of the one before.
  void accept();
  /// Takes the next connection; the one before stays open, and silent.
  void accept_beside();
  /// Takes the next connection on which the robot says hello: those of other attempts it closes.
  wire::Hello accept_hello();
  /// accept_hello(), welcome.
  wire::Hello welcome(const wire::Position& position);

  /// The next message; nothing once the peer has closed.
  std::optional<Message> read_any();
  /// The next one but stats.
  std::optional<Message> read();
  /// The next message of that type; others before it are read and forgotten.
  Message read(wire::Type type);
  /// The next items of that stream.
  wire::Items read_items(wire::StreamId stream);
  NumberedDrops read_drops();
  void send(const std::vector<std::uint8_t>& bytes);
  /// received: all that is acknowledged, unless the test says more.
  void ack(const wire::Position& position, std::optional<Sequence> received = std::nullopt);
  void close();
  /// As a program that is killed: ends the connection, and takes no more.
  void die();

 private:
  boost::asio::io_context io_;
  boost::asio::ip::tcp::acceptor acceptor_;
  boost::asio::ip::tcp::socket socket_;
  std::vector<boost::asio::ip::tcp::socket> silent_;
};

}  // namespace orbbuf::test
