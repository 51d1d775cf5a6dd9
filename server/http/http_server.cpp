// SPDX-License-Identifier: Apache-2.0
#include "server/http/http_server.hpp"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/write.hpp>

#include "common/as_bytes.hpp"
#include "common/log.hpp"
#include "server/runtime/listen_on.hpp"
#include "server/runtime/longest_waiting.hpp"
#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

std::span<const std::uint8_t> body_of(const HttpResponse& response) {
  if (response.image) return response.image->left();
  if (!response.text) return {};
  return as_bytes(*response.text);
}

std::filesystem::path folder_of(const SinkSettings& sinks) {
  return sinks.files_enabled ? sinks.files_path : std::filesystem::path();
}

}  // namespace

/// One browser's connection: a request, its answer, the next request. Whatever it does, or does not
/// do, costs the robots' streams nothing to speak of: it has a time for each request and each piece
/// of an answer, and is cut when that is over. What blocks is done on `files`, a piece at a time.
/// Thread-bound to `main`. Lives in a shared_ptr, held by its owner and its operations.
class HttpServer::Connection final : public std::enable_shared_from_this<Connection> {
 public:
  /// `tls`: null for plain TCP. `files` and `owner` must outlive every run of the io_context.
  Connection(tcp::socket socket, TlsContext* tls, PoolStrand& files, HttpServer& owner)
      : peer_(peer_of(socket)),
        stream_(std::make_unique<Stream>(std::move(socket), tls)),
        files_(files),
        owner_(owner),
        timer_(stream_->get_executor()) {}

  void start() {
    error_code ignored;  // answers are then merely later
    stream_->socket().set_option(tcp::no_delay(true), ignored);
    limit(kRequestTime);
    if (!stream_->is_tls()) return read();
    stream_->async_handshake_as_server([self = shared_from_this()](const error_code& failed) {
      if (self->is_closed_) return;
      if (!failed) return self->read();
      log_debug("http: {}", self->stream_->explain(failed));
      self->close();
    });
  }

  const tcp::endpoint& peer() const { return peer_; }
  /// It has neither begun a request nor taken a piece of an answer since.
  std::chrono::steady_clock::time_point since() const { return since_; }
  /// At once; harmless when repeated.
  void close() {
    if (std::exchange(is_closed_, true)) return;
    const auto self = shared_from_this();  // the owner lets go of it
    timer_.cancel();
    error_code ignored;  // there is nothing to do about it
    stream_->socket().close(ignored);
    owner_.on_closed(self);
  }

 private:
  /// Answers what has come already; false if there is nothing to answer yet.
  bool serve() {
    if (const auto request = reader_.next()) {
      ask(*request);
      return true;
    }
    if (reader_.fault() == 0) return false;
    respond(error_response(reader_.fault()), false, false);
    return true;
  }

  /// After an answer.
  void go_on() {
    if (serve()) return;
    if (reader_.is_between_requests()) limit(kIdleTime);
    read();
  }

  void read() {
    stream_->async_read_some(asio::buffer(in_), [self = shared_from_this()](
                                                    const error_code& failed, std::size_t bytes) {
      if (self->is_closed_) return;
      if (failed) return self->close();  // gone, or as good as that
      self->on_bytes(bytes);
    });
  }

  /// The bytes of a request that come in drops do not buy it time.
  void on_bytes(std::size_t bytes) {
    if (reader_.is_between_requests()) limit(kRequestTime);
    reader_.add(std::span(in_).first(bytes));
    if (!serve()) read();
  }

  void ask(const HttpRequest& request) {
    limit(kPieceTime);
    if (request.upgrade && reader_.is_between_requests() && owner_.can_upgrade(request)) {
      return give_away(request);
    }
    const bool is_head = request.is_head;
    const bool keeps_alive = request.keeps_alive;
    owner_.on_request(request,
                      [self = shared_from_this(), is_head, keeps_alive](HttpResponse answer) {
                        if (self->is_closed_) return;
                        self->respond(std::move(answer), is_head, keeps_alive);
                      });
  }

  void give_away(const HttpRequest& request) {
    const auto self = shared_from_this();  // the owner lets go of it
    is_closed_ = true;
    timer_.cancel();
    owner_.on_upgrade(std::move(stream_), request);
    owner_.on_closed(self);
  }

  void respond(HttpResponse response, bool is_head, bool keeps_alive) {
    response_ = std::move(response);
    keeps_alive_ = keeps_alive;
    head_ = head_of(response_, keeps_alive);
    written_ = 0;
    left_ = is_head ? 0 : response_.body_bytes();
    if (left_ == 0) return write({});
    write_next();
  }

  void write_next() {
    if (response_.file) return read_file();
    // A body in memory: its size is a size_t, also where that has 32 bits.
    const auto size = std::min<std::uint64_t>(left_, ServedFile::kPieceBytes);
    write(body_of(response_).subspan(static_cast<std::size_t>(written_),
                                     static_cast<std::size_t>(size)));
  }

  void read_file() {
    run_in_pool(
        stream_->get_executor(), files_, [file = response_.file] { return file->read(); },
        [self = shared_from_this()](std::vector<std::uint8_t> piece) {
          if (self->is_closed_) return;
          if (piece.empty()) return self->close();  // what was promised is not there any more
          self->piece_ = std::move(piece);
          self->write(self->piece_);
        });
  }

  void write(std::span<const std::uint8_t> piece) {
    limit(kPieceTime);
    written_ += piece.size();
    left_ -= piece.size();
    const std::array<asio::const_buffer, 2> parts = {asio::buffer(head_),
                                                     asio::buffer(piece.data(), piece.size())};
    asio::async_write(*stream_, parts,
                      [self = shared_from_this()](const error_code& failed, std::size_t) {
                        if (self->is_closed_) return;
                        if (failed) return self->close();
                        self->on_written();
                      });
  }

  void on_written() {
    head_.clear();
    if (left_ > 0) return write_next();
    response_ = {};
    if (!keeps_alive_) return part();
    go_on();
  }

  /// Closing at once, with something of the other end's unread, might lose it the answer.
  void part() {
    error_code ignored;  // then it is gone, which reading shows
    stream_->socket().shutdown(tcp::socket::shutdown_send, ignored);
    stream_->go_bare();
    limit(kPartingTime);
    discard();
  }

  void discard() {
    stream_->async_read_some(asio::buffer(in_),
                             [self = shared_from_this()](const error_code& failed, std::size_t) {
                               if (self->is_closed_) return;
                               if (failed) return self->close();
                               self->discard();
                             });
  }

  void limit(std::chrono::seconds time) {
    since_ = std::chrono::steady_clock::now();
    timer_.expires_after(time);
    timer_.async_wait([weak = weak_from_this()](const error_code& failed) {
      const auto self = weak.lock();
      if (failed || !self || self->timer_.expiry() > std::chrono::steady_clock::now()) return;
      self->close();
    });
  }

  const tcp::endpoint peer_;
  std::unique_ptr<Stream> stream_;  // null: given away
  PoolStrand& files_;
  HttpServer& owner_;
  asio::steady_timer timer_;
  std::chrono::steady_clock::time_point since_;
  bool is_closed_ = false;

  RequestReader reader_;
  std::array<std::uint8_t, 4096> in_{};

  // The answer that is being written.
  HttpResponse response_;
  std::string head_;
  std::vector<std::uint8_t> piece_;  // of a file
  std::uint64_t written_ = 0;
  std::uint64_t left_ = 0;
  bool keeps_alive_ = false;
};

HttpServer::HttpServer(asio::io_context& main, asio::thread_pool& files, const Settings& settings,
                       Metrics& metrics)
    : files_(asio::make_strand(files)),
      tls_(make_tls_context(settings.listen.tls)),
      router_(main, files_, metrics, folder_of(settings.sinks),
              !tls_ && is_loopback(*settings.http_address)),
      foxglove_(std::make_shared<FoxgloveServer>(main, metrics)),
      acceptor_(listen_on(main, "serve http on", *settings.http_address)),
      retry_(main) {
  metrics.watch(foxglove_);
}

void HttpServer::start() {
  log_info("live page on http{}://{}/", tls_ ? "s" : "", to_text(endpoint()));
  accept();
}

void HttpServer::stop() {
  error_code ignored;  // it is closed either way
  acceptor_.close(ignored);
  retry_.cancel();
  const auto connections = connections_;  // a connection that closes leaves the original
  for (const auto& connection : connections) connection->close();
  foxglove_->stop();
}

void HttpServer::accept() {
  acceptor_.async_accept([this](const error_code& failed, tcp::socket socket) {
    if (!acceptor_.is_open()) return;  // stopped
    if (failed) return accept_later();
    if (connections_.size() >= kMaxConnections) {
      longest_waiting(connections_, [](const auto& /*connection*/) { return true; })->close();
    }
    auto connection = std::make_shared<Connection>(std::move(socket), tls_.get(), files_, *this);
    connections_.insert(connection);
    connection->start();
    accept();
  });
}

/// Out of descriptors or memory, mostly, of which the robots' listener tells.
void HttpServer::accept_later() {
  retry_.expires_after(kRetry);
  retry_.async_wait([this](const error_code& aborted) {
    if (!aborted && acceptor_.is_open()) accept();
  });
}

void HttpServer::on_request(const HttpRequest& request, Router::Answer answer) {
  if (request.upgrade && router_.is_for_this_host(request)) {
    if (auto refusal = foxglove_->refusal_of(request)) return answer(std::move(*refusal));
  }
  router_.answer(request, std::move(answer));
}

bool HttpServer::can_upgrade(const HttpRequest& request) {
  return router_.is_for_this_host(request) && !foxglove_->refusal_of(request);
}

void HttpServer::on_upgrade(std::unique_ptr<Stream> stream, const HttpRequest& request) {
  foxglove_->accept(std::move(stream), request);
}

void HttpServer::on_closed(const std::shared_ptr<Connection>& connection) {
  connections_.erase(connection);
}

}  // namespace orbbuf
