// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/address.hpp"
#include "common/error.hpp"

namespace orbbuf::fleet {

/// Gets files from a server's page: plain HTTP over one connection, kept as long as the server
/// keeps it, one call at a time. Thread-bound to `main`. Lives in a shared_ptr, which its
/// operations hold.
class PageClient : public std::enable_shared_from_this<PageClient> {
 public:
  /// Nothing: there is no such file.
  using Done = std::function<void(Result<std::optional<std::string>>)>;

  /// patience: for a connection, and for each piece of an answer.
  PageClient(boost::asio::io_context& main, Address page,
             std::chrono::milliseconds patience = std::chrono::seconds(5))
      : main_(main), page_(std::move(page)), patience_(patience), resolver_(main) {}

  /// path: percent-encoded where that is needed. `done` never runs from within the call.
  void async_get(std::string path, Done done);
  /// The outstanding call ends soon, with an error. Harmless when repeated.
  void close();

  const Address& page() const { return page_; }

 private:
  void connect();
  void ask();
  void read();
  void on_answer();
  void on_failed(const boost::system::error_code& failed);
  void finish(Result<std::optional<std::string>> answer);

  boost::asio::io_context& main_;
  const Address page_;
  const std::chrono::milliseconds patience_;
  boost::asio::ip::tcp::resolver resolver_;
  std::optional<boost::beast::tcp_stream> stream_;  // nothing: not connected
  bool is_kept_ = false;                            // it has answered before
  bool is_closed_ = false;
  std::string path_;
  Done done_;
  boost::beast::flat_buffer buffer_;
  boost::beast::http::request<boost::beast::http::empty_body> request_;
  std::optional<boost::beast::http::response_parser<boost::beast::http::string_body>> parser_;
};

}  // namespace orbbuf::fleet
