// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <cstdint>
#include <string>
#include <string_view>

#include "common/address.hpp"

namespace orbbuf {

/// A listening socket, on the first address that the host stands for. receive_buffer_bytes: of the
/// sockets that it accepts; 0: the kernel's choice. Resolves a name, so it may block. Throws
/// std::runtime_error: `attempt ADDRESS: reason`.
boost::asio::ip::tcp::acceptor listen_on(boost::asio::io_context& main, std::string_view attempt,
                                         const Address& address,
                                         std::uint32_t receive_buffer_bytes = 0);

/// No address if it is gone already.
boost::asio::ip::tcp::endpoint peer_of(const boost::asio::ip::tcp::socket& socket);

/// `ADDRESS:PORT`, as it is written in configurations.
std::string to_text(const boost::asio::ip::tcp::endpoint& endpoint);

}  // namespace orbbuf
