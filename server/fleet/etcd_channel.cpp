// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/etcd_channel.hpp"

#include <fmt/core.h>

#include <boost/asio/connect.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/write.hpp>
#include <utility>

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::uint64_t kMostBytes = 64UL * 1024 * 1024;
constexpr std::chrono::milliseconds kRound{200};  // when all endpoints have failed in turn
constexpr unsigned kFirstOfServer = 500;

}  // namespace

EtcdChannel::EtcdChannel(asio::io_context& main, Options options)
    : main_(main),
      options_(std::move(options)),
      tls_(make_tls_context(options_.tls)),
      resolver_(main),
      timer_(main) {}

void EtcdChannel::async_post(std::string path, std::string body, Done done) {
  if (is_stopped_) {
    asio::post(main_, [done = std::move(done)] { done(Error{"etcd: the server stops"}); });
    return;
  }
  calls_.push_back(
      {std::move(path), std::move(body), std::move(done), Clock::now() + options_.patience});
  asio::post(main_, [this] { next(); });
}

/// Its operations end, unheard.
void EtcdChannel::disconnect() {
  is_connected_ = false;
  resolver_.cancel();
  error_code ignored;  // there is nothing to do about it
  if (const auto link = std::exchange(link_, nullptr)) link->stream.socket().close(ignored);
}

void EtcdChannel::stop() {
  is_stopped_ = true;
  disconnect();
  timer_.cancel();
  for (auto& call : std::exchange(calls_, {})) {
    asio::post(main_, [done = std::move(call.done)] { done(Error{"etcd: the server stops"}); });
  }
}

void EtcdChannel::next() {
  if (is_busy_ || calls_.empty() || is_stopped_) return;
  is_busy_ = true;
  ++requests_;
  begun_ = Clock::now();
  attempt();
}

void EtcdChannel::attempt() {
  if (is_stopped_) return;
  if (Clock::now() >= calls_.front().limit) {
    return finish(Error{fmt::format("etcd: {} did not answer in time", to_string(endpoint()))});
  }
  timer_.expires_after(options_.attempt);
  timer_.async_wait([this](const error_code& aborted) {
    if (!aborted && !is_stopped_ && timer_.expiry() <= Clock::now()) on_failed("no answer");
  });
  if (is_connected_) return send();
  connect();
}

template <class Step>
auto EtcdChannel::guarded(const char* what, Step step) {
  return [this, what, step, link = link_](const error_code& failed, const auto&... /*rest*/) {
    if (link != link_ || is_stopped_) return;
    if (failed) return on_failed(fmt::format("{}: {}", what, link->stream.explain(failed)));
    step();
  };
}

void EtcdChannel::connect() {
  link_ = std::make_shared<Link>(tcp::socket(main_), tls_.get());
  resolver_.async_resolve(
      endpoint().host, std::to_string(endpoint().port),
      [this, link = link_](const error_code& failed, const tcp::resolver::results_type& found) {
        if (link != link_ || is_stopped_) return;
        if (failed) return on_failed("resolve: " + failed.message());
        asio::async_connect(link->stream.socket(), found, guarded("connect", [this] {
                              error_code ignored;  // requests are then merely later
                              link_->stream.socket().set_option(tcp::no_delay(true), ignored);
                              const auto ready = [this] {
                                is_connected_ = true;
                                send();
                              };
                              if (!link_->stream.is_tls()) return ready();
                              link_->stream.async_handshake_as_robot(endpoint().host,
                                                                     guarded("TLS", ready));
                            }));
      });
}

void EtcdChannel::send() {
  const Call& call = calls_.front();
  Request& request = link_->request;
  request = Request(http::verb::post, call.path, 11);
  request.set(http::field::host, to_string(endpoint()));
  request.set(http::field::content_type, "application/json");
  request.body() = call.body;
  request.prepare_payload();
  http::async_write(link_->stream, request, guarded("write", [this] {
                      Parser& parser = link_->parser.emplace();
                      parser.body_limit(kMostBytes);
                      http::async_read(link_->stream, link_->buffer, parser,
                                       guarded("read", [this] { on_answer(); }));
                    }));
}

/// A server error, no leader for one, is an endpoint's; what another endpoint would say as well is
/// the answer.
void EtcdChannel::on_answer() {
  auto response = link_->parser->release();
  const unsigned status = response.result_int();
  if (status >= kFirstOfServer) return on_failed(fmt::format("HTTP {}", status));
  if (!response.keep_alive()) disconnect();
  failed_in_turn_ = 0;
  time_spent_ += Clock::now() - begun_;
  if (status == 200) return finish(std::move(response.body()));
  finish(Error{fmt::format("etcd: HTTP {}: {}", status, response.body())});
}

void EtcdChannel::on_failed(const std::string& why) {
  ++failures_;
  disconnect();
  timer_.cancel();
  const std::string what = fmt::format("etcd: {}: {}", to_string(endpoint()), why);
  endpoint_ = (endpoint_ + 1) % options_.endpoints.size();
  if (Clock::now() + kRound >= calls_.front().limit) return finish(Error{what});
  if (++failed_in_turn_ % options_.endpoints.size() != 0) return attempt();
  timer_.expires_after(kRound);
  timer_.async_wait([this](const error_code& aborted) {
    if (!aborted) attempt();
  });
}

void EtcdChannel::finish(Result<std::string> answer) {
  timer_.cancel();
  const Done done = std::move(calls_.front().done);
  calls_.pop_front();
  is_busy_ = false;
  asio::post(main_, [this] { next(); });
  done(std::move(answer));
}

}  // namespace orbbuf
