// SPDX-License-Identifier: Apache-2.0
// orbbuf-evaluation-link ROBOT SERVER [TRACE BYTES_PER_S OFFSET_S]
// A mobile link between two network namespaces, each of which gets its end as the interface `wire`:
// kernel TCP on both sides, in between this process. What the robot sends passes in order, at the
// rates of TRACE (as bench/sim/mobile_link.hpp reads it) scaled to a mean of BYTES_PER_S (0:
// unscaled) from OFFSET_S on; without TRACE at once. What more than kQueueBytes wait before is
// lost, as in a modem. The other direction is free. Says "wire" when it is up. On the standard
// input:
//   delay MS    how late everything is that the robot sends from now on (sec. IV-A's T)
// Ends with its standard input.
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <deque>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "bench/plain_socket.hpp"
#include "bench/run_program.hpp"
#include "bench/sim/mobile_link.hpp"
#include "common/unique_fd.hpp"

namespace {

using orbbuf::UniqueFd;
using orbbuf::bench::check;
using Packet = std::vector<char>;

constexpr std::size_t kQueueBytes = 100'000;
constexpr std::size_t kPacketBytes = 2048;  // more than the MTU of 1500
constexpr std::int64_t kNsPerMs = 1'000'000;

UniqueFd enter_and_make_wire(const std::string& network_namespace) {
  const std::string path = "/run/netns/" + network_namespace;
  const UniqueFd space(static_cast<int>(check(::open(path.c_str(), O_RDONLY | O_CLOEXEC), path)));
  check(::setns(space.get(), CLONE_NEWNET), "enter " + path);
  UniqueFd wire(static_cast<int>(
      check(::open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC), "open /dev/net/tun")));
  ifreq request{};
  std::strcpy(request.ifr_name, "wire");
  request.ifr_flags = IFF_TUN | IFF_NO_PI;
  check(::ioctl(wire.get(), TUNSETIFF, &request), "make the interface `wire` in " + path);
  return wire;
}

/// A packet from a wire that may have none; or, of several, the next.
std::optional<Packet> read_packet(const UniqueFd& wire) {
  Packet packet(kPacketBytes);
  const ssize_t size = ::read(wire.get(), packet.data(), packet.size());
  if (size < 0 && errno == EAGAIN) return std::nullopt;
  packet.resize(static_cast<std::size_t>(check(size, "read a packet")));
  return packet;
}

/// An end that is not up yet takes none.
void write_packet(const UniqueFd& wire, const Packet& packet) {
  const ssize_t size = ::write(wire.get(), packet.data(), packet.size());
  if (size < 0 && errno != EIO && errno != EAGAIN) check(size, "write a packet");
}

struct Rates {
  orbbuf::sim::RateTrace trace;
  double scale = 1;
  double offset_s = 0;
};

class Link {
 public:
  Link(const std::string& robot, const std::string& server, std::optional<Rates> rates)
      : robot_(enter_and_make_wire(robot)),
        server_(enter_and_make_wire(server)),
        rates_(std::move(rates)) {}

  void run() {
    std::puts("wire");
    std::fflush(stdout);
    for (;;) {
      std::array<pollfd, 3> fds{
          {{STDIN_FILENO, POLLIN, 0}, {robot_.get(), POLLIN, 0}, {server_.get(), POLLIN, 0}}};
      const timespec wait = until_next();
      check(::ppoll(fds.data(), fds.size(), waiting_.empty() ? nullptr : &wait, nullptr), "wait");
      if (fds[0].revents != 0 && !obey()) return;
      while (auto packet = read_packet(robot_)) take(std::move(*packet));
      while (const auto packet = read_packet(server_)) write_packet(robot_, *packet);
      let_go();
    }
  }

 private:
  struct Waiting {
    std::int64_t passed_ns = 0;  ///< when it has left the queue
    std::int64_t arrives_ns = 0;
    Packet packet;
  };

  std::int64_t now_ns() const {
    return std::chrono::nanoseconds(std::chrono::steady_clock::now() - begin_).count();
  }

  timespec until_next() const {
    if (waiting_.empty()) return {};
    const auto left = std::max<std::int64_t>(0, waiting_.front().arrives_ns - now_ns());
    return {left / (1000 * kNsPerMs), left % (1000 * kNsPerMs)};
  }

  /// False at the end of the standard input.
  bool obey() {
    std::array<char, 256> line{};
    const ssize_t size = ::read(STDIN_FILENO, line.data(), line.size() - 1);
    long delay_ms = 0;
    if (check(size, "read the standard input") == 0) return false;
    if (std::sscanf(line.data(), "delay %ld", &delay_ms) != 1 || delay_ms < 0) {
      throw std::runtime_error("expected \"delay MS\"");
    }
    delay_ns_ = delay_ms * kNsPerMs;
    return true;
  }

  void take(Packet packet) {
    const std::int64_t now = now_ns();
    std::size_t queued = 0;
    for (const Waiting& waiting : waiting_) {
      if (waiting.passed_ns > now) queued += waiting.packet.size();
    }
    if (queued > kQueueBytes) return;
    const std::int64_t start = std::max(now, waiting_.empty() ? now : waiting_.back().passed_ns);
    const std::int64_t passed =
        rates_ ? finish(rates_->trace, rates_->scale, rates_->offset_s, start, packet.size()) : now;
    const std::int64_t earlier = waiting_.empty() ? 0 : waiting_.back().arrives_ns;
    waiting_.push_back({passed, std::max(earlier, passed + delay_ns_), std::move(packet)});
  }

  void let_go() {
    while (!waiting_.empty() && waiting_.front().arrives_ns <= now_ns()) {
      write_packet(server_, waiting_.front().packet);
      waiting_.pop_front();
    }
  }

  const UniqueFd robot_;
  const UniqueFd server_;
  const std::optional<Rates> rates_;
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  std::int64_t delay_ns_ = 0;
  std::deque<Waiting> waiting_;
};

std::optional<Rates> rates_from(const std::vector<std::string>& words) {
  if (words.size() < 5) return std::nullopt;
  Rates rates{orbbuf::sim::read_trace(words[2]), 1, std::stod(words[4])};
  const double mean_bytes_per_s = std::stod(words[3]);
  if (mean_bytes_per_s > 0) rates.scale = mean_bytes_per_s / rates.trace.mean_bytes_per_s();
  return rates;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() != 2 && words.size() != 5) {
    std::fputs("usage: orbbuf-evaluation-link ROBOT SERVER [TRACE BYTES_PER_S OFFSET_S]\n", stderr);
    return 2;
  }
  return orbbuf::bench::run_program("orbbuf-evaluation-link",
                                    [&] { Link(words[0], words[1], rates_from(words)).run(); });
}
