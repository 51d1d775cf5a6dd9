// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/page_client.hpp"

#include <fmt/core.h>

#include <boost/asio/post.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/write.hpp>
#include <utility>

namespace orbbuf::fleet {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::uint64_t kMostBytes = 1024UL * 1024 * 1024;
constexpr unsigned kOk = 200;
constexpr unsigned kNotFound = 404;

}  // namespace

void PageClient::async_get(std::string path, Done done) {
  path_ = std::move(path);
  done_ = std::move(done);
  asio::post(main_, [self = shared_from_this()] {
    if (self->is_closed_) return self->on_failed(asio::error::operation_aborted);
    self->stream_ ? self->ask() : self->connect();
  });
}

void PageClient::close() {
  is_closed_ = true;
  resolver_.cancel();
  if (stream_) stream_->close();
}

void PageClient::connect() {
  is_kept_ = false;
  resolver_.async_resolve(
      page_.host, std::to_string(page_.port),
      [self = shared_from_this()](error_code failed, const tcp::resolver::results_type& found) {
        if (self->is_closed_) failed = asio::error::operation_aborted;
        if (failed) return self->on_failed(failed);
        self->buffer_.clear();
        self->stream_.emplace(self->main_);
        self->stream_->expires_after(self->patience_);
        self->stream_->async_connect(
            found, [self](const error_code& refused, const tcp::endpoint& /*peer*/) {
              if (refused) return self->on_failed(refused);
              error_code ignored;  // requests are then merely later
              self->stream_->socket().set_option(tcp::no_delay(true), ignored);
              self->ask();
            });
      });
}

void PageClient::ask() {
  request_ = {http::verb::get, path_, 11};
  request_.set(http::field::host, to_string(page_));
  parser_.emplace();
  parser_->body_limit(kMostBytes);
  stream_->expires_after(patience_);
  http::async_write(*stream_, request_,
                    [self = shared_from_this()](const error_code& failed, std::size_t) {
                      if (failed) return self->on_failed(failed);
                      self->read();
                    });
}

/// A piece: a long answer may take its time as long as it comes.
void PageClient::read() {
  stream_->expires_after(patience_);
  http::async_read_some(*stream_, buffer_, *parser_,
                        [self = shared_from_this()](const error_code& failed, std::size_t) {
                          if (failed) return self->on_failed(failed);
                          self->parser_->is_done() ? self->on_answer() : self->read();
                        });
}

void PageClient::on_answer() {
  auto response = parser_->release();
  is_kept_ = response.keep_alive();
  if (!is_kept_) stream_.reset();
  const unsigned status = response.result_int();
  if (status == kOk) return finish(std::optional(std::move(response.body())));
  if (status == kNotFound) return finish(std::optional<std::string>());
  finish(Error{fmt::format("fetch http://{}{}: HTTP {}", to_string(page_), path_, status)});
}

/// A connection that was kept may have gone meanwhile.
void PageClient::on_failed(const error_code& failed) {
  stream_.reset();
  if (is_kept_ && !is_closed_) return connect();
  finish(Error{
      fmt::format("fetch http://{}{}: no answer: {}", to_string(page_), path_, failed.message())});
}

void PageClient::finish(Result<std::optional<std::string>> answer) {
  std::exchange(done_, nullptr)(std::move(answer));
}

}  // namespace orbbuf::fleet
