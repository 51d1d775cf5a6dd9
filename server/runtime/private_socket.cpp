// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/private_socket.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <stdexcept>

namespace orbbuf {

boost::asio::local::stream_protocol::acceptor listen_privately(boost::asio::io_context& main,
                                                               const std::string& key,
                                                               const std::filesystem::path& path) {
  using Protocol = boost::asio::local::stream_protocol;
  try {
    const Protocol::endpoint endpoint(path.string());
    Protocol::socket other(main);
    boost::system::error_code failed;
    other.connect(endpoint, failed);
    if (!failed) throw std::runtime_error(key + ": another server is on " + path.string());
    if (failed == boost::asio::error::connection_refused && std::filesystem::is_socket(path)) {
      ::unlink(path.c_str());
    }
    const mode_t mask = ::umask(S_IRWXG | S_IRWXO);
    Protocol::acceptor acceptor(main, endpoint.protocol());
    acceptor.bind(endpoint, failed);
    ::umask(mask);
    if (failed) throw boost::system::system_error(failed);
    acceptor.listen();
    return acceptor;
  } catch (const boost::system::system_error& error) {
    throw std::runtime_error(key + ": listen on " + path.string() + ": " + error.code().message());
  }
}

}  // namespace orbbuf
