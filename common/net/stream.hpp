// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <optional>
#include <string>
#include <utility>

#include "common/net/tls.hpp"

namespace orbbuf {

/// A TCP connection, plain or under TLS 1.3, for asio::async_read() and async_write(): the code of
/// the protocol is the same for both. The stream must outlive its operations. Thread-bound to the
/// thread that runs its io_context.
class Stream {
 public:
  using Tcp = boost::asio::ip::tcp;
  using executor_type = Tcp::socket::executor_type;  // as Asio wants it named

  /// `socket` may be connected later. `tls`: null for plain; only read here.
  Stream(Tcp::socket socket, TlsContext* tls);
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  /// The socket, to connect, configure and close. Read and write through the stream.
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

  /// From now on reads return the raw bytes of the socket, without TLS: to drain what the peer
  /// still sends before the connection is closed.
  void read_bare() { is_bare_ = true; }

  /// The common name in the peer's certificate; empty if there is no certificate, or if it has no
  /// common name or several. Valid after the handshake.
  std::string peer_name();

  /// Why a handshake or a read failed, in words: which certificate was rejected and why, or the
  /// alert that the peer sent.
  std::string explain(const boost::system::error_code& failed) const;

 private:
  void expect_host(const std::string& host);

  Tcp::socket socket_;
  std::optional<boost::asio::ssl::stream<Tcp::socket&>> tls_;
  bool is_bare_ = false;
  bool is_host_expected_ = true;  // false if the check could not be set: then none will do
  std::string refused_;           // which certificate was rejected, and why
};

}  // namespace orbbuf
