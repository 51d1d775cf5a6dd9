// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/parser.hpp>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

namespace orbbuf {

/// Whether `host`, that of a request, is localhost or an address, with or without a port. A page of
/// another machine that has a name cannot make a browser say so.
bool is_own_host(const std::string& host);

/// Whether a page from `page_host` may see what a request to `host` shows: it comes from the
/// viewer's own machine, or from the very address that the request is sent to. Ports do not count.
bool is_own_page(const std::string& page_host, const std::string& host);

/// A request whole, as Beast needs it to answer one for WebSocket.
using UpgradeRequest = boost::beast::http::request<boost::beast::http::empty_body>;

/// A request that asks for something, and no more.
struct HttpRequest {
  bool is_get = true;  ///< GET or HEAD
  bool is_head = false;
  bool keeps_alive = false;
  std::string host;   ///< the field, as it came
  std::string path;   ///< begins with '/'; not decoded, since no name of ours needs it
  std::string query;  ///< behind '?'
  std::shared_ptr<const UpgradeRequest> upgrade{};  ///< set if it asks for WebSocket
};

/// Cuts a connection's bytes into requests without bodies. Knows no sockets. Memory: at most
/// kMaxBytes, and what a call brings. Reentrant.
class RequestReader {
 public:
  static constexpr std::uint32_t kMaxBytes = 8192;  ///< of a request; more is refused
  static constexpr unsigned kBadRequest = 400;

  RequestReader() { begin(); }

  void add(std::span<const std::uint8_t> bytes);
  /// The next request; nothing if more bytes are needed, or after a fault.
  std::optional<HttpRequest> next();
  /// The HTTP status that tells what is wrong with the bytes, which cannot be read on then; 0 if
  /// nothing is.
  unsigned fault() const { return fault_; }
  bool is_between_requests() const { return bytes_.empty(); }

 private:
  using Parser = boost::beast::http::request_parser<boost::beast::http::empty_body>;

  void begin();
  HttpRequest take();

  std::string bytes_;
  std::optional<Parser> parser_;
  unsigned fault_ = 0;
};

}  // namespace orbbuf
