// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/socket_samples.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <boost/asio/buffer.hpp>
#include <stdexcept>
#include <utility>

#include "common/log.hpp"
#include "common/text_lines.hpp"

namespace orbbuf {
namespace {

using Datagrams = boost::asio::local::datagram_protocol;

constexpr mode_t kForAll = S_IRUSR | S_IWUSR | S_IRGRP | S_IWGRP | S_IROTH | S_IWOTH;

Datagrams::socket listen_at(boost::asio::io_context& main, const std::filesystem::path& path) {
  const Datagrams::endpoint endpoint(path.string());
  boost::system::error_code failed;
  if (std::filesystem::exists(path) && !std::filesystem::is_socket(path)) {
    throw std::runtime_error("there is something that is no socket");
  }
  Datagrams::socket other(main, Datagrams());
  other.connect(endpoint, failed);
  if (!failed) throw std::runtime_error("another process listens there");
  if (failed == boost::asio::error::connection_refused) ::unlink(path.c_str());
  Datagrams::socket socket(main, endpoint);
  if (::chmod(path.c_str(), kForAll) != 0) {
    throw boost::system::system_error(errno, boost::system::system_category());
  }
  return socket;
}

}  // namespace

SocketSamples::SocketSamples(boost::asio::io_context& main, const SampleStreamSettings& settings,
                             Take take)
    : name_(settings.name), path_(settings.path), take_(std::move(take)), socket_(main) {
  try {
    socket_ = listen_at(main, path_);
  } catch (const std::runtime_error& error) {  // Asio's system_error is one
    throw std::runtime_error(
        fmt::format("{}: listen on {}: {}", name_, path_.string(), error.what()));
  }
  receive();
}

SocketSamples::~SocketSamples() { ::unlink(path_.c_str()); }

void SocketSamples::receive() {
  socket_.async_receive(
      boost::asio::buffer(datagram_),
      [this, life = life()](const boost::system::error_code& error, std::size_t bytes) {
        if (life.expired()) return;
        if (error) {
          log_error("{}: receive on {}: {}", name_, path_.string(), error.message());
          return;
        }
        read({datagram_.data(), bytes});
        receive();
      });
}

void SocketSamples::read(std::string_view text) {
  while (!text.empty()) {
    if (const auto sample = parse_euroc_line(take_line(text))) {
      take_(*sample);
    } else if (!std::exchange(is_fault_logged_, true)) {
      log_warn("{}: a line at {} is ignored, and so are others like it: {}", name_, path_.string(),
               kExpectedEurocLine);
    }
  }
}

}  // namespace orbbuf
