// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <cstdint>
#include <memory>
#include <set>

namespace orbbuf::bench {

/// A robot's link that can be cut: takes connections on a free port of loopback, and passes on what
/// comes in both directions. Thread-bound to the thread that runs the io_context, which it must
/// outlive.
class Relay {
 public:
  Relay(boost::asio::io_context& io, boost::asio::ip::tcp::endpoint to);

  std::uint16_t port() const { return acceptor_.local_endpoint().port(); }
  /// Ends the connections that there are, at both ends.
  void cut();
  void stop();

 private:
  using Tcp = boost::asio::ip::tcp;
  struct Pair {
    explicit Pair(boost::asio::io_context& io) : robot(io), server(io) {}
    Tcp::socket robot;
    Tcp::socket server;
    std::array<std::uint8_t, 16384> up{};
    std::array<std::uint8_t, 16384> down{};
  };

  void accept();
  void pass(const std::shared_ptr<Pair>& pair, Tcp::socket& from, Tcp::socket& to,
            std::array<std::uint8_t, 16384>& bytes);
  void close(const std::shared_ptr<Pair>& pair);

  boost::asio::io_context& io_;
  const Tcp::endpoint to_;
  Tcp::acceptor acceptor_;
  std::set<std::shared_ptr<Pair>> pairs_;
};

}  // namespace orbbuf::bench
