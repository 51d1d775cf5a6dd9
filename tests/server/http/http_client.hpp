// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/socket.h>

#include <string>
#include <string_view>

#include "testing/robot_client.hpp"

namespace orbbuf::test {

struct HttpAnswer {
  int status = 0;  ///< 0: the connection was closed instead
  std::string head;
  std::string body;
};

/// A browser's side of a connection, byte by byte, over a real loopback socket.
class HttpClient {
 public:
  explicit HttpClient(std::uint16_t port, UniqueFd socket = RobotClient::tcp_socket())
      : connection_(port, std::move(socket)) {}

  void send(std::string_view bytes) const { connection_.send_text(bytes); }
  /// Reads one answer; of a HEAD, no body.
  HttpAnswer read(bool is_head = false) const {
    HttpAnswer answer;
    while (!answer.head.ends_with("\r\n\r\n")) {
      char byte = 0;
      if (::recv(connection_.fd(), &byte, 1, 0) != 1) return answer;
      answer.head += byte;
    }
    answer.status = std::stoi(answer.head.substr(9));
    const std::size_t length = answer.head.find("Content-Length: ");
    answer.body.resize(is_head ? 0 : std::stoull(answer.head.substr(length + 16)));
    if (!answer.body.empty() && ::recv(connection_.fd(), answer.body.data(), answer.body.size(),
                                       MSG_WAITALL) != static_cast<ssize_t>(answer.body.size())) {
      answer.status = 0;
    }
    return answer;
  }
  HttpAnswer get(const std::string& path) const {
    send("GET " + path + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
    return read();
  }
  bool is_closed() const { return connection_.is_closed(); }
  int fd() const { return connection_.fd(); }

 private:
  RobotClient connection_;
};

}  // namespace orbbuf::test
