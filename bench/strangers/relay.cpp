// SPDX-License-Identifier: Apache-2.0
#include "bench/strangers/relay.hpp"

#include <boost/asio/write.hpp>
#include <utility>

namespace orbbuf::bench {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

}  // namespace

Relay::Relay(asio::io_context& io, Tcp::endpoint to)
    : io_(io), to_(std::move(to)), acceptor_(io, {asio::ip::address_v4::loopback(), 0}) {
  accept();
}

void Relay::accept() {
  const auto pair = std::make_shared<Pair>(io_);
  acceptor_.async_accept(pair->robot, [this, pair](const error_code& failed) {
    if (failed) return;
    pairs_.insert(pair);
    pair->server.async_connect(to_, [this, pair](const error_code& refused) {
      if (refused) return close(pair);
      error_code ignored;  // then it is merely slower
      pair->robot.set_option(Tcp::no_delay(true), ignored);
      pair->server.set_option(Tcp::no_delay(true), ignored);
      pass(pair, pair->robot, pair->server, pair->up);
      pass(pair, pair->server, pair->robot, pair->down);
    });
    accept();
  });
}

void Relay::pass(const std::shared_ptr<Pair>& pair, Tcp::socket& from, Tcp::socket& to,
                 std::array<std::uint8_t, 16384>& bytes) {
  from.async_read_some(asio::buffer(bytes), [this, pair, &from, &to, &bytes](
                                                const error_code& ended, std::size_t n) {
    if (ended == asio::error::eof) {
      error_code ignored;  // then it is gone, which the other direction shows
      to.shutdown(Tcp::socket::shutdown_send, ignored);
      return;
    }
    if (ended) return close(pair);
    asio::async_write(to, asio::buffer(bytes, n),
                      [this, pair, &from, &to, &bytes](const error_code& gone, std::size_t) {
                        gone ? close(pair) : pass(pair, from, to, bytes);
                      });
  });
}

void Relay::close(const std::shared_ptr<Pair>& pair) {
  for (Tcp::socket* socket : {&pair->robot, &pair->server}) {
    error_code ignored;                                     // it is closed either way
    socket->shutdown(Tcp::socket::shutdown_both, ignored);  // a program begun since has it, too
    socket->close(ignored);
  }
  pairs_.erase(pair);
}

void Relay::cut() {
  const auto pairs = pairs_;  // one that is closed is removed from the original
  for (const auto& pair : pairs) close(pair);
}

void Relay::stop() {
  error_code ignored;  // it is closed either way
  acceptor_.close(ignored);
  cut();
}

}  // namespace orbbuf::bench
