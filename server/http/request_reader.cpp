// SPDX-License-Identifier: Apache-2.0
#include "server/http/request_reader.hpp"

#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/beast/websocket/rfc6455.hpp>

namespace orbbuf {
namespace {

namespace ip = boost::asio::ip;

std::string without_port(const std::string& host) {
  const std::size_t colon = host.rfind(':');
  const bool has_port = colon != std::string::npos && host.find(']', colon) == std::string::npos;
  std::string name = has_port ? host.substr(0, colon) : host;
  if (name.starts_with('[') && name.ends_with(']')) name = name.substr(1, name.size() - 2);
  return name;
}

/// Nothing for a name, except for localhost.
std::optional<ip::address> address_of(const std::string& host) {
  const std::string name = without_port(host);
  if (name == "localhost") return ip::address_v4::loopback();
  boost::system::error_code is_name;
  const ip::address address = ip::make_address(name, is_name);
  return is_name ? std::nullopt : std::optional(address);
}

namespace http = boost::beast::http;
using boost::system::error_code;

constexpr unsigned kTooLarge = 413;
constexpr unsigned kFieldsTooLarge = 431;

unsigned status_for(const error_code& failed) {
  if (failed == http::error::header_limit) return kFieldsTooLarge;
  if (failed == http::error::body_limit || failed == http::error::unexpected_body) return kTooLarge;
  return RequestReader::kBadRequest;
}

}  // namespace

bool is_own_host(const std::string& host) { return address_of(host).has_value(); }

bool is_own_page(const std::string& page_host, const std::string& host) {
  const auto page = address_of(page_host);
  return page && (page->is_loopback() || page == address_of(host));
}

void RequestReader::begin() {
  parser_.emplace();
  parser_->header_limit(kMaxBytes);
  parser_->body_limit(0);
  parser_->eager(true);
}

void RequestReader::add(std::span<const std::uint8_t> bytes) {
  bytes_.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

std::optional<HttpRequest> RequestReader::next() {
  if (fault_ != 0 || bytes_.empty()) return std::nullopt;
  error_code failed;
  const std::size_t used = parser_->put(boost::asio::buffer(bytes_), failed);
  bytes_.erase(0, used);
  if (failed == http::error::need_more) failed = {};
  if (failed) {
    fault_ = status_for(failed);
  } else if (!parser_->is_done() && bytes_.size() > kMaxBytes) {
    fault_ = kFieldsTooLarge;
  }
  if (fault_ != 0 || !parser_->is_done()) return std::nullopt;
  auto request = take();
  begin();
  if (fault_ != 0) return std::nullopt;
  return request;
}

HttpRequest RequestReader::take() {
  const auto& message = parser_->get();
  HttpRequest request;
  request.is_head = message.method() == http::verb::head;
  request.is_get = request.is_head || message.method() == http::verb::get;
  request.keeps_alive = message.keep_alive();
  request.host = std::string(message[http::field::host]);
  const std::string target(message.target());
  const std::size_t question = target.find('?');
  request.path = target.substr(0, question);
  if (question != std::string::npos) request.query = target.substr(question + 1);
  if (!request.path.starts_with('/')) fault_ = kBadRequest;
  if (boost::beast::websocket::is_upgrade(message)) {
    request.upgrade = std::make_shared<const UpgradeRequest>(message);
  }
  return request;
}

}  // namespace orbbuf
