// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/net/stream.hpp"
#include "common/wire.hpp"
#include "daemon/net/server_addresses.hpp"
#include "daemon/net/tcp_progress.hpp"

namespace orbbuf {

/// One TCP connection to the server, from the SYN to its end: says hello, reads what the server
/// says, writes one message at a time. What to write, and what to do when it fails, is the owner's
/// matter.
///
/// Thread-bound to `main`. Kept alive by its own pending operations; silent after close().
class ServerConnection : public std::enable_shared_from_this<ServerConnection> {
 public:
  /// Called from the io_context only, never from within a call to the connection.
  class Owner {
   public:
    /// On the way to being welcome: TCP is there, or TLS. Each step takes a round trip. The owner
    /// may close the connection from within this call, before it says hello.
    virtual void on_step(const ServerConnection& from) = 0;
    /// Why the position of a welcome is not accepted: it is a refusal then, and on_failed()
    /// follows.
    virtual std::optional<Error> refusal_of(const wire::Position& position) = 0;
    /// The server's position; writing may begin.
    virtual void on_welcome(const wire::Position& position) = 0;
    virtual void on_ack(const wire::Ack& ack) = 0;
    /// The server's last message: all is recorded up to `position`, or it is going down.
    virtual void on_bye(const wire::Position& position) = 0;
    /// The last message has gone to the kernel, which has little left unsent: the moment to choose
    /// the next one.
    virtual void on_writable() = 0;
    /// The connection could not be made, or broke. Last call.
    virtual void on_failed(const ServerConnection& from, const Error& error) = 0;

   protected:
    ~Owner() = default;
  };

  struct Way {
    ServerAddress to;
    std::string interface;    ///< as bind_interface() takes it; empty: the kernel's choice
    int largest_segment = 0;  ///< in bytes, either way; 0: as the interface has it

    /// For messages: " over INTERFACE", or nothing.
    std::string over() const { return interface.empty() ? "" : " over " + interface; }
    /// For messages: "HOST:PORT over INTERFACE", or "HOST:PORT".
    std::string name() const { return to_string(to.server) + over(); }
    bool operator==(const Way&) const = default;
  };

  /// `owner` must outlive the connection or its close(); `tls`, null for plain TCP, the
  /// io_context's last run.
  ServerConnection(boost::asio::io_context& io, TlsContext* tls, Owner& owner);

  /// Connects by `way` to the server, which under TLS must prove to be way.to.server.host, and says
  /// `hello`. From then on the kernel keeps at most about `unsent_limit` bytes unsent.
  void open(const Way& way, const wire::Hello& hello, std::uint32_t unsent_limit);

  /// Where it goes, since open().
  const Way& way() const { return way_; }
  /// What the server said in it. Requires that on_welcome() was called.
  const wire::Welcome& welcome() const { return *welcome_; }
  /// The server's side answered and wants no connection with this robot: its error says so, or the
  /// certificates do not fit. There is no use in asking again at once.
  bool was_refused() const { return was_refused_; }
  /// The server had welcomed the robot, and cannot keep what it sends.
  bool was_sent_away() const { return was_sent_away_; }

  /// From then on the server may have given this connection the place of an older one.
  bool has_said_hello() const { return has_said_hello_; }

  /// True between on_writable() and the next write. Requires it before a write.
  bool is_writable() const { return is_writable_; }
  void write(std::vector<std::uint8_t> message);
  void write(FramePtr frame);

  /// What the kernel says of the sending side; nothing if it cannot tell.
  std::optional<TcpProgress> progress() { return tcp_progress(stream_.socket().native_handle()); }

  /// Ends the connection at once, unsent bytes and all. No more calls to the owner.
  void close();

 private:
  using FrameHead = std::array<std::uint8_t, wire::kHeaderBytes + wire::kFrameMetaBytes>;

  std::optional<Error> prepare_socket();
  void on_connected(std::uint32_t unsent_limit);
  void say_hello();
  void wait_writable();
  void on_written(const boost::system::error_code& error);
  void read_header();
  void on_no_header(const wire::Fault& fault);
  void read_body(const wire::Header& header);
  void dispatch(const wire::Header& header);
  template <class Message>
  bool accept(const wire::Parsed<Message>& message);
  void fail(const Error& error);
  void fail(const std::string& attempt, const boost::system::error_code& error);
  void refuse(const Error& error);
  void on_error(const wire::ErrorMessage& error);

  Stream stream_;
  Owner* owner_;  // null once closed
  Way way_;
  bool was_refused_ = false;
  bool was_sent_away_ = false;
  bool is_writable_ = false;
  bool has_said_hello_ = false;
  std::optional<wire::Welcome> welcome_;
  std::vector<std::uint8_t> message_;  // being written
  FramePtr frame_;                     // being written
  FrameHead frame_head_{};
  std::array<std::uint8_t, wire::kHeaderBytes> header_{};
  std::vector<std::uint8_t> body_;
};

}  // namespace orbbuf
