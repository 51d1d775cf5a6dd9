// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/container/static_vector.hpp>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>
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

  using Handshaken = std::function<void(const boost::system::error_code&)>;

  /// `socket` may be connected later. `tls`: null for plain; only read here.
  Stream(Tcp::socket socket, TlsContext* tls);
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;
  ~Stream();

  /// The socket, to connect, configure and close. Read and write through the stream.
  Tcp::socket& socket() { return socket_; }
  executor_type get_executor() { return socket_.get_executor(); }
  bool is_tls() const { return tls_ != nullptr; }

  /// The robot's side: the server's certificate must be for `host`, a name or an address.
  void async_handshake_as_robot(const std::string& host, Handshaken handler);
  void async_handshake_as_server(Handshaken handler);

  // What Asio's reads and writes are made of. Their code is compiled once, in stream.cpp.
  template <class Sequence, class Handler>
  void async_read_some(const Sequence& buffers, Handler&& handler) {
    read_some(first_of<boost::asio::mutable_buffer>(buffers), Done(std::forward<Handler>(handler)));
  }
  template <class Sequence, class Handler>
  void async_write_some(const Sequence& buffers, Handler&& handler) {
    write_some(first_of<boost::asio::const_buffer>(buffers), Done(std::forward<Handler>(handler)));
  }

  /// From now on reads and writes are the raw bytes of the socket, without TLS: to drain what the
  /// peer still sends before the connection is closed, or to answer one that does not use TLS.
  void go_bare() { is_bare_ = true; }

  /// Whether a handshake failed with that because the peer does not use TLS.
  static bool is_peer_plain(const boost::system::error_code& failed);

  /// The common name in the peer's certificate; empty if there is no certificate, or if it has no
  /// common name or several. Valid after the handshake.
  std::string peer_name();

  /// Why a handshake or a read failed, in words: which certificate was rejected and why, or the
  /// alert that the peer sent.
  std::string explain(const boost::system::error_code& failed) const;

 private:
  struct Tls;  // OpenSSL's part

  /// A handler of any type, to be called once; it may be movable only.
  class Done {
   public:
    template <class Handler, class = std::enable_if_t<!std::is_same_v<std::decay_t<Handler>, Done>>>
    explicit Done(Handler&& handler)
        : call_(std::make_unique<Call<std::decay_t<Handler>>>(std::forward<Handler>(handler))) {}
    void operator()(const boost::system::error_code& failed, std::size_t bytes) {
      call_->run(failed, bytes);
    }

   private:
    struct AnyCall {
      virtual ~AnyCall() = default;
      virtual void run(const boost::system::error_code& failed, std::size_t bytes) = 0;
    };
    template <class Handler>
    struct Call final : AnyCall {
      explicit Call(Handler taken) : handler(std::move(taken)) {}
      void run(const boost::system::error_code& failed, std::size_t bytes) override {
        handler(failed, bytes);
      }
      Handler handler;
    };
    std::unique_ptr<AnyCall> call_;
  };

  /// As many as one system call shall take.
  template <class Buffer>
  using Buffers = boost::container::static_vector<Buffer, 16>;
  template <class Buffer, class Sequence>
  static Buffers<Buffer> first_of(const Sequence& buffers) {
    Buffers<Buffer> first;
    const auto end = boost::asio::buffer_sequence_end(buffers);
    for (auto at = boost::asio::buffer_sequence_begin(buffers);
         at != end && first.size() < first.capacity(); ++at) {
      first.push_back(*at);
    }
    return first;
  }

  void read_some(const Buffers<boost::asio::mutable_buffer>& buffers, Done done);
  void write_some(const Buffers<boost::asio::const_buffer>& buffers, Done done);
  void expect_host(const std::string& host);

  Tcp::socket socket_;
  std::unique_ptr<Tls> tls_;  // null: plain
  bool is_bare_ = false;
  bool is_host_expected_ = true;  // false if the check could not be set: then none will do
  std::string refused_;           // which certificate was rejected, and why
};

}  // namespace orbbuf
