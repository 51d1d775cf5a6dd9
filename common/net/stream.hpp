// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <optional>
#include <string>
#include <utility>

#include "common/net/tls.hpp"

namespace orbbuf {

/// A TCP connection's bytes, plain or under TLS 1.3: what asio::async_read() and async_write()
/// take, so that whoever speaks the protocol need not know which it is. The stream must outlive its
/// operations. Thread-bound to the thread that runs its io_context.
class Stream {
 public:
  using Tcp = boost::asio::ip::tcp;
  using executor_type = Tcp::socket::executor_type;  // as Asio wants it named

  /// `socket` may be connected later. `tls`, null for plain, must outlive the stream.
  Stream(Tcp::socket socket, TlsContext* tls);
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  /// The connection itself: to connect, wait for, ask and close. Reading and writing go through the
  /// stream.
  Tcp::socket& socket() { return socket_; }
  executor_type get_executor() { return socket_.get_executor(); }
  bool is_tls() const { return tls_.has_value(); }

  /// The robot's side: the server's certificate must be for `host`, a name or an address.
  template <class Handler>
  void async_handshake_as_robot(const std::string& host, Handler&& handler) {
    expect_host(host);
    tls_->async_handshake(boost::asio::ssl::stream_base::client, std::forward<Handler>(handler));
  }
  template <class Handler>
  void async_handshake_as_server(Handler&& handler) {
    tls_->async_handshake(boost::asio::ssl::stream_base::server, std::forward<Handler>(handler));
  }

  template <class Buffers, class Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    if (tls_ && !is_bare_) {
      tls_->async_read_some(buffers, std::forward<Handler>(handler));
    } else {
      socket_.async_read_some(buffers, std::forward<Handler>(handler));
    }
  }
  template <class Buffers, class Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    if (tls_) {
      tls_->async_write_some(buffers, std::forward<Handler>(handler));
    } else {
      socket_.async_write_some(buffers, std::forward<Handler>(handler));
    }
  }

  /// From here on reads give the bytes as they come, whatever they mean: there is no talking to
  /// the other end any more, but what it still sends can be read away.
  void read_bare() { is_bare_ = true; }

  /// The common name in the other end's certificate; empty if it has none, or several, or there is
  /// no certificate. After the handshake.
  std::string peer_name();

  /// Why a handshake or a read failed, in words: which certificate was refused and what for, or
  /// what the other end said of ours.
  std::string explain(const boost::system::error_code& failed) const;

 private:
  void expect_host(const std::string& host);

  Tcp::socket socket_;
  std::optional<boost::asio::ssl::stream<Tcp::socket&>> tls_;
  bool is_bare_ = false;
  bool is_host_expected_ = true;  // or it could not be: then no certificate will do
  std::string refused_;           // the certificate that was, and why
};

}  // namespace orbbuf
