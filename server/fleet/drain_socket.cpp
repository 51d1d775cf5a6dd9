// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/drain_socket.hpp"

#include <unistd.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <string>
#include <string_view>
#include <utility>

#include "server/runtime/private_socket.hpp"

namespace orbbuf::fleet {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

constexpr std::string_view kDrained = "drained\n";

}  // namespace

DrainSocket::DrainSocket(asio::io_context& main, std::filesystem::path path,
                         std::function<void(Done)> drain)
    : path_(std::move(path)),
      drain_(std::move(drain)),
      acceptor_(listen_privately(main, "status.socket", path_)) {}

DrainSocket::~DrainSocket() { ::unlink(path_.c_str()); }

void DrainSocket::stop() {
  error_code ignored;  // it is closed either way
  acceptor_.close(ignored);
  waiting_.clear();
}

void DrainSocket::accept() {
  acceptor_.async_accept([this](const error_code& failed, Protocol::socket socket) {
    if (failed) return;  // stopped, or no descriptors: then who asks has no answer
    waiting_.push_back(std::make_unique<Protocol::socket>(std::move(socket)));
    accept();
    if (is_drained_) return on_drained(std::nullopt);
    if (!std::exchange(is_draining_, true)) {
      drain_([this](const std::optional<Error>& error) { on_drained(error); });
    }
  });
}

void DrainSocket::on_drained(const std::optional<Error>& error) {
  is_draining_ = false;
  is_drained_ = !error;
  const std::string line = error ? error->text + "\n" : std::string(kDrained);
  for (const auto& socket : std::exchange(waiting_, {})) {
    error_code ignored;  // who asked has gone
    asio::write(*socket, asio::buffer(line), ignored);
  }
}

std::filesystem::path drain_socket_of(const std::filesystem::path& status_socket) {
  if (status_socket.empty()) return {};
  return status_socket.string() + ".drain";
}

std::optional<Error> ask_drain(const std::filesystem::path& path, std::chrono::seconds patience) {
  asio::io_context io;
  asio::local::stream_protocol::socket socket(io);
  error_code failed;
  socket.connect({path.string()}, failed);
  if (failed) return Error{path.string() + ": " + failed.message()};
  std::string line;
  bool is_over = false;
  asio::async_read(socket, asio::dynamic_buffer(line),
                   [&](const error_code& /*end*/, std::size_t /*bytes*/) { is_over = true; });
  io.run_for(patience);
  if (!is_over)
    return Error{path.string() + ": robots are still there"};  // of `line` nothing holds
  if (line == kDrained) return std::nullopt;
  if (line.empty()) return Error{path.string() + ": the server ended without an answer"};
  line.pop_back();
  return Error{line};
}

}  // namespace orbbuf::fleet
