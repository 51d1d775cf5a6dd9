// SPDX-License-Identifier: Apache-2.0
// Stderr is a full pipe that nothing reads: the programs lose lines of the log, and nothing else.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <csignal>

#include "common/address.hpp"
#include "common/unique_fd.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

namespace asio = boost::asio;
using testing::HasSubstr;

/// A FIFO to be the stderr of a program.
class LogPipe {
 public:
  explicit LogPipe(const std::filesystem::path& path) : path_(path) {
    EXPECT_EQ(::mkfifo(path.c_str(), 0600), 0);
    fd_ = UniqueFd(::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
  }
  /// Words before a command, which is then without other output.
  std::vector<std::string> where() const {
    return {"sh", "-c", "exec \"$@\" >/dev/null 2>\"$0\"", path_.string()};
  }
  void fill() const {
    const std::array<char, 4096> junk{};
    while (::write(fd_.get(), junk.data(), junk.size()) > 0 || ::write(fd_.get(), "", 1) > 0) {
    }
  }
  void empty() { read_on(); }
  /// What follows `text` in its line, once that has been written. Reads no further than needed.
  std::string wait_for(const std::string& text) {
    std::size_t at = 0;
    while ((at = read_.find(text)) == read_.npos || read_.find('\n', at) == read_.npos) {
      pollfd entry{fd_.get(), POLLIN, 0};
      if (::poll(&entry, 1, 60'000) != 1) throw std::runtime_error("no line with " + text);
      read_on();
    }
    at += text.size();
    return read_.substr(at, read_.find('\n', at) - at);
  }

 private:
  void read_on() {
    std::array<char, 4096> piece{};
    for (ssize_t size = 0; (size = ::read(fd_.get(), piece.data(), piece.size())) > 0;) {
      read_.append(piece.data(), static_cast<std::size_t>(size));
    }
  }

  const std::filesystem::path path_;
  UniqueFd fd_;
  std::string read_;
};

std::string get(const Address& page, const std::string& path) {
  asio::io_context io;
  asio::ip::tcp::socket socket(io);
  socket.connect({asio::ip::make_address(page.host), page.port});
  asio::write(socket, asio::buffer("GET " + path + " HTTP/1.0\r\nHost: localhost\r\n\r\n"));
  std::string answer;
  boost::system::error_code ended;
  asio::read(socket, asio::dynamic_buffer(answer), ended);
  return answer;
}

TEST(StuckLog, RobotServerAndHealthzGoOn) {
  constexpr int kLoggedFrames = 100;
  const TemporaryFolder folder;
  LogPipe server_log(folder / "server.log");
  LogPipe robot_log(folder / "robot.log");
  auto command = server_log.where();
  command.insert(command.end(),
                 {kOrbbufServer, "--set", "listen.address=127.0.0.1:0", "--set",
                  "files.path=" + (folder / "out").string(), "--set", "http.address=127.0.0.1:0"});
  Process server(command);
  const auto page = server_log.wait_for("live page on http://");
  const auto address = server_log.wait_for("] listening on ");
  server_log.fill();
  robot_log.fill();

  Process robot(
      robot_command("r", address,
                    {"source.frames=" + std::to_string(kLoggedFrames), "source.realtime=false",
                     "source.width=160", "source.height=120", "log.level=trace"},
                    robot_log.where()));
  EXPECT_EQ(robot.wait(), 0);
  expect_exactly_once(read_record(folder / "out", "r"), kLoggedFrames);
  EXPECT_THAT(get(parse_address(page.substr(0, page.find('/'))).value(), "/healthz"),
              HasSubstr("200 OK"));

  server_log.empty();
  server.signal(SIGTERM);
  EXPECT_THAT(server_log.wait_for(" lines of the log were lost"), HasSubstr("stderr"));
  EXPECT_EQ(server.wait(), 0);
}

}  // namespace
}  // namespace orbbuf::test
