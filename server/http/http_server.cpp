// SPDX-License-Identifier: Apache-2.0
#include "server/http/http_server.hpp"

#include <utility>

#include "common/log.hpp"
#include "server/runtime/listen_on.hpp"
#include "server/runtime/longest_waiting.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

std::filesystem::path folder_of(const SinkSettings& sinks) {
  return sinks.files_enabled ? sinks.files_path : std::filesystem::path();
}

}  // namespace

HttpServer::HttpServer(asio::io_context& main, asio::thread_pool& files, const Settings& settings,
                       Metrics& metrics, FleetPage fleet)
    : files_(files),
      tls_(make_tls_context(settings.listen.tls)),
      router_(main, files, metrics, folder_of(settings.sinks),
              !tls_ && is_loopback(*settings.http_address), std::move(fleet)),
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
    auto connection = std::make_shared<HttpConnection>(std::move(socket), tls_.get(), files_,
                                                       static_cast<HttpOwner&>(*this));
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

void HttpServer::on_request(const HttpRequest& request, Answer answer) {
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

void HttpServer::on_closed(const std::shared_ptr<HttpConnection>& connection) {
  connections_.erase(connection);
}

}  // namespace orbbuf
