// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <filesystem>
#include <string>

namespace orbbuf {

/// A listening socket that only this user can connect to; one that a dead server has left behind is
/// replaced. Throws std::runtime_error, `key: listen on PATH: why`, also if another server listens
/// there.
boost::asio::local::stream_protocol::acceptor listen_privately(boost::asio::io_context& main,
                                                               const std::string& key,
                                                               const std::filesystem::path& path);

}  // namespace orbbuf
