// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fetch_segment.hpp"

#include <spdlog/fmt/fmt.h>

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <fstream>
#include <sstream>

#include "server/fleet/etcd_client.hpp"

namespace orbbuf::fleet {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
namespace fs = std::filesystem;
using boost::system::error_code;

constexpr std::uint64_t kMostBytes = 2UL * 1024 * 1024 * 1024;
constexpr unsigned kOk = 200;
constexpr unsigned kNotFound = 404;

/// One connection, kept as long as the server keeps it.
class Page {
 public:
  explicit Page(Address address) : address_(std::move(address)), socket_(io_) {}

  /// Nothing: there is no such file.
  Result<std::optional<std::string>> get(const std::string& path) {
    error_code failed;
    for (const bool is_last : {false, true}) {  // a connection that was kept may have gone
      if (!socket_.is_open()) failed = connect();
      http::response_parser<http::string_body> parser;
      if (!failed) failed = ask(path, parser);
      if (!failed) return answer(path, parser.release());
      socket_.close(failed);
      if (is_last) break;
    }
    return Error{fmt::format("fetch http://{}{}: no answer", to_string(address_), path)};
  }

 private:
  error_code connect() {
    error_code failed;
    asio::ip::tcp::resolver resolver(io_);
    const auto found = resolver.resolve(address_.host, std::to_string(address_.port), failed);
    if (!failed) asio::connect(socket_, found, failed);
    return failed;
  }

  error_code ask(const std::string& path, http::response_parser<http::string_body>& parser) {
    error_code failed;
    http::request<http::empty_body> request(http::verb::get, path, 11);
    request.set(http::field::host, to_string(address_));
    http::write(socket_, request, failed);
    parser.body_limit(kMostBytes);
    if (!failed) http::read(socket_, buffer_, parser, failed);
    return failed;
  }

  Result<std::optional<std::string>> answer(const std::string& path,
                                            http::response<http::string_body> response) {
    error_code ignored;  // it is closed either way
    if (!response.keep_alive()) socket_.close(ignored);
    if (response.result_int() == kOk) return std::optional(std::move(response.body()));
    if (response.result_int() == kNotFound) return std::optional<std::string>();
    return Error{fmt::format("fetch http://{}{}: HTTP {}", to_string(address_), path,
                             response.result_int())};
  }

  const Address address_;
  asio::io_context io_;
  asio::ip::tcp::socket socket_;
  boost::beast::flat_buffer buffer_;
};

std::optional<Error> keep(const fs::path& path, const std::string& content) {
  std::error_code ignored;  // then writing says why
  fs::create_directories(path.parent_path(), ignored);
  std::ofstream out(path, std::ios::binary);
  if (out << content && out.flush()) return std::nullopt;
  return system_error("write " + path.string(), errno);
}

/// Nothing if it is missing.
Result<std::string> fetch(Page& page, const std::string& from, const std::string& name,
                          const fs::path& to) {
  auto content = page.get(from + name);
  if (!content) return std::move(content).error();
  if (!content.value()) return std::string();
  if (auto error = keep(to / name, *content.value())) return std::move(*error);
  return std::move(*content.value());
}

}  // namespace

Result<std::vector<FoundSegment>> find_segments(const std::vector<Address>& etcd,
                                                const SessionName& session) {
  asio::io_context io;
  EtcdClient client(io, {etcd, {}});
  std::optional<Result<std::vector<KeyTxnOutcome>>> owners;
  std::optional<Result<std::vector<KeyValue>>> servers;
  client.async_txns({{{}, {}, {session.owner_key()}}},
                    [&](auto outcomes) { owners = std::move(outcomes); });
  client.async_range(std::string(kServers), [&](auto found) { servers = std::move(found); });
  io.run();
  if (!*owners) return owners->error();
  if (!*servers) return servers->error();
  const auto& found = owners->value().front().found;
  const auto owner = found.empty() ? std::nullopt : owner_from(found.front().value);
  if (!owner) return Error{"etcd: no session " + session.text()};
  std::vector<FoundSegment> segments;
  for (const Segment& segment : owner->segments) {
    FoundSegment& entry = segments.emplace_back(FoundSegment{segment, ""});
    for (const KeyValue& key : servers->value()) {
      const auto server = server_from(key.key, key.value);
      if (server && server->name == segment.server) entry.http = server->http;
    }
  }
  return segments;
}

std::optional<Error> fetch_segment(const Address& address, const std::string& robot_id,
                                   const std::string& folder, const fs::path& to) {
  Page page(address);
  const std::string from = fmt::format("/sessions/{}/{}/", robot_id, folder);
  std::string checksums;
  for (const char* const name :
       {"times.txt", "drops.csv", "camera.txt", "end.csv", "segment.csv", "checksums.sfv"}) {
    auto content = fetch(page, from, name, to);
    if (!content) return std::move(content).error();
    checksums = std::move(content).value();
  }
  std::istringstream lines(checksums);
  for (std::string line; std::getline(lines, line);) {
    const std::string image = line.substr(0, line.rfind(' '));
    const bool is_image = image.starts_with("images/") || image.starts_with("images_right/");
    if (!is_image || image.find("..") != std::string::npos) continue;
    if (auto content = fetch(page, from, image, to); !content) return std::move(content).error();
  }
  return std::nullopt;
}

}  // namespace orbbuf::fleet
