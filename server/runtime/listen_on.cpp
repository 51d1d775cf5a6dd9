// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/listen_on.hpp"

#include <fmt/core.h>

#include <stdexcept>

namespace orbbuf {
namespace asio = boost::asio;
using asio::ip::tcp;

tcp::acceptor listen_on(asio::io_context& main, std::string_view attempt, const Address& address,
                        std::uint32_t receive_buffer_bytes) {
  try {
    tcp::resolver resolver(main);
    const tcp::endpoint endpoint =
        *resolver.resolve(address.host, std::to_string(address.port), tcp::resolver::passive);
    tcp::acceptor acceptor(main, endpoint.protocol());
    acceptor.set_option(tcp::acceptor::reuse_address(true));
    if (receive_buffer_bytes > 0) {  // accepted sockets inherit it, if set before listen
      acceptor.set_option(
          asio::socket_base::receive_buffer_size(static_cast<int>(receive_buffer_bytes)));
    }
    acceptor.bind(endpoint);
    acceptor.listen();
    return acceptor;
  } catch (const boost::system::system_error& error) {
    throw std::runtime_error(
        fmt::format("{} {}: {}", attempt, to_string(address), error.code().message()));
  }
}

tcp::endpoint peer_of(const tcp::socket& socket) {
  boost::system::error_code gone;  // then there is no address, and the next read fails
  return socket.remote_endpoint(gone);
}

std::string to_text(const tcp::endpoint& endpoint) {
  return to_string(Address{endpoint.address().to_string(), endpoint.port()});
}

}  // namespace orbbuf
