// SPDX-License-Identifier: Apache-2.0
#include "server/live/control_socket.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/write.hpp>
#include <cstdlib>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using Protocol = asio::local::stream_protocol;
using boost::system::error_code;

constexpr std::size_t kMaxWordBytes = 32;
constexpr std::string_view kOk = "ok\n";
constexpr std::string_view kError = "error ";

/// systemd's, of the unit that the package installs.
constexpr const char* kServiceSocket = "/run/orbbuf-server/status";

fs::path in_folder_of(const char* variable, const char* name) {
  const char* const folder = std::getenv(variable);  // NOLINT(concurrency-mt-unsafe)
  return folder == nullptr || *folder == '\0' ? fs::path() : fs::path(folder) / name;
}

fs::path own_socket() { return in_folder_of("XDG_RUNTIME_DIR", "orbbuf-server.sock"); }

error_code connect(Protocol::socket& socket, const fs::path& path) {
  error_code failed;
  try {
    socket.connect(Protocol::endpoint(path.string()), failed);
  } catch (const boost::system::system_error& error) {  // a path too long for a socket
    failed = error.code();
  }
  return failed;
}

/// Nothing of an answer that is not whole holds.
Result<std::string> ask(asio::io_context& io, Protocol::socket& socket, const std::string& word,
                        std::chrono::seconds patience) {
  error_code gone;  // then reading finds no answer
  asio::write(socket, asio::buffer(word + '\n'), gone);
  std::string answer;
  bool is_over = false;
  asio::async_read(socket, asio::dynamic_buffer(answer),
                   [&](const error_code& /*end*/, std::size_t /*bytes*/) { is_over = true; });
  io.run_for(patience);
  if (!is_over) return Error{"no answer"};
  if (answer.empty()) return Error{"the server ended without an answer"};
  if (!answer.ends_with('\n')) return Error{"the answer was cut short"};
  if (answer.starts_with(kOk)) return answer.substr(kOk.size());
  answer.pop_back();
  return Error{answer.substr(answer.starts_with(kError) ? kError.size() : 0)};
}

/// Throws std::runtime_error, also if another server listens there.
Protocol::acceptor listen_privately(asio::io_context& main, const fs::path& path) {
  try {
    const Protocol::endpoint endpoint(path.string());
    Protocol::socket other(main);
    error_code failed;
    other.connect(endpoint, failed);
    if (!failed) throw std::runtime_error("status.socket: another server is on " + path.string());
    if (failed == asio::error::connection_refused && fs::is_socket(path)) ::unlink(path.c_str());
    const mode_t mask = ::umask(S_IRWXG | S_IRWXO);
    Protocol::acceptor acceptor(main, endpoint.protocol());
    acceptor.bind(endpoint, failed);
    ::umask(mask);
    if (failed) throw boost::system::system_error(failed);
    acceptor.listen();
    return acceptor;
  } catch (const boost::system::system_error& error) {
    throw std::runtime_error("status.socket: listen on " + path.string() + ": " +
                             error.code().message());
  }
}

}  // namespace

fs::path control_socket_path(const std::string& setting) {
  if (setting != kAutomaticSocket) return setting;
  const fs::path service = in_folder_of("RUNTIME_DIRECTORY", "status");
  return service.empty() ? own_socket() : service;
}

/// Lives as long as one of its operations, or the answer that a command keeps.
struct ControlSocket::Client {
  explicit Client(Protocol::socket connected)
      : socket(std::move(connected)), timer(socket.get_executor()) {}

  void close() {
    error_code ignored;  // it is closed either way
    socket.close(ignored);
    timer.cancel();
  }

  Protocol::socket socket;
  asio::steady_timer timer;
  std::string text;
  bool has_spoken = false;
};

ControlSocket::ControlSocket(asio::io_context& main, fs::path path,
                             std::map<std::string, Command> commands)
    : path_(std::move(path)),
      commands_(std::move(commands)),
      acceptor_(listen_privately(main, path_)),
      retry_(main) {}

ControlSocket::~ControlSocket() { ::unlink(path_.c_str()); }

void ControlSocket::stop() {
  error_code ignored;  // it is closed either way
  acceptor_.close(ignored);
  retry_.cancel();
  for (const auto& [key, weak] : clients_) {
    if (const auto client = weak.lock()) client->close();
  }
}

void ControlSocket::accept() {
  acceptor_.async_accept([this](const error_code& failed, Protocol::socket socket) {
    if (!acceptor_.is_open() || failed == asio::error::operation_aborted) return;
    if (failed) return accept_later();  // no descriptors, of which the robots' listener tells
    std::erase_if(clients_, [](const auto& entry) { return entry.second.expired(); });
    if (clients_.size() < kMostClients) read_word(std::make_shared<Client>(std::move(socket)));
    accept();
  });
}

void ControlSocket::accept_later() {
  retry_.expires_after(kRetry);
  retry_.async_wait([this](const error_code& aborted) {
    if (!aborted && acceptor_.is_open()) accept();
  });
}

void ControlSocket::read_word(const std::shared_ptr<Client>& client) {
  clients_[client.get()] = client;
  client->timer.expires_after(kWordTimeout);
  client->timer.async_wait([weak = std::weak_ptr(client)](const error_code& aborted) {
    const auto silent = aborted ? nullptr : weak.lock();
    if (silent && !silent->has_spoken) silent->close();
  });
  asio::async_read_until(client->socket, asio::dynamic_buffer(client->text, kMaxWordBytes), '\n',
                         [this, client](const error_code& failed, std::size_t bytes) {
                           client->has_spoken = true;
                           client->timer.cancel();
                           if (!failed) run(client, client->text.substr(0, bytes - 1));
                         });
}

void ControlSocket::run(const std::shared_ptr<Client>& client, const std::string& word) {
  const Answer answer = [client](const Result<std::string>& text) {
    client->text =
        text ? std::string(kOk) + text.value() : std::string(kError) + text.error().text + '\n';
    asio::async_write(client->socket, asio::buffer(client->text),
                      [client](const error_code& /*gone*/, std::size_t /*bytes*/) {});
  };
  const auto command = commands_.find(word);
  if (command == commands_.end()) return answer(Error{"the server has no command " + word});
  command->second(answer);
}

Result<std::string> ask_server(const std::string& setting, const std::string& word,
                               std::chrono::seconds patience) {
  std::vector<fs::path> paths{setting};
  if (setting == kAutomaticSocket) paths = {own_socket(), kServiceSocket};
  std::string tried;
  if (paths.front().empty() && setting == kAutomaticSocket) {
    tried = "not this user's, since XDG_RUNTIME_DIR is not set (name its status.socket)";
  }
  for (const fs::path& path : paths) {
    if (path.empty()) continue;
    asio::io_context io;
    Protocol::socket socket(io);
    if (const auto failed = connect(socket, path)) {
      tried += (tried.empty() ? "" : "; ") + path.string() + ": " + failed.message();
      continue;
    }
    auto answer = ask(io, socket, word, patience);
    if (!answer) return Error{path.string() + ": " + answer.error().text};
    return answer;
  }
  return Error{"no server answers: " + (tried.empty() ? "status.socket is off" : tried)};
}

}  // namespace orbbuf
