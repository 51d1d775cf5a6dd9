// SPDX-License-Identifier: Apache-2.0
#include "bench/link/long_path.hpp"

#include <fcntl.h>
#include <linux/if.h>
#include <linux/if_tun.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <deque>
#include <vector>

#include "bench/plain_socket.hpp"

namespace orbbuf::bench {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kLargestPacket = 65536;

struct Packet {
  Clock::time_point due;
  int to = -1;
  std::vector<char> bytes;
};

int make_interface(const std::string& name) {
  const int device = static_cast<int>(
      check(::open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC), "open /dev/net/tun"));
  ifreq request{};
  request.ifr_flags = IFF_TUN | IFF_NO_PI;
  name.copy(request.ifr_name, IFNAMSIZ - 1);
  check(::ioctl(device, TUNSETIFF, &request), "make the interface " + name);
  return device;
}

/// All that `from` has by now, to be at `to` later.
void take(int from, int to, std::chrono::nanoseconds delay, std::deque<Packet>& on_the_way) {
  std::array<char, kLargestPacket> bytes;
  for (;;) {
    const ssize_t size = ::read(from, bytes.data(), bytes.size());
    if (size <= 0) return;
    on_the_way.push_back({Clock::now() + delay, to, {bytes.data(), bytes.data() + size}});
  }
}

}  // namespace

void carry_packets(const std::string& near_end, const std::string& far_end,
                   std::chrono::nanoseconds delay) {
  const std::array<int, 2> ends{make_interface(near_end), make_interface(far_end)};
  std::fprintf(stderr, "path from %s to %s\n", near_end.c_str(), far_end.c_str());
  std::deque<Packet> on_the_way;
  for (;;) {
    std::array<pollfd, 2> ready{{{ends[0], POLLIN, 0}, {ends[1], POLLIN, 0}}};
    timespec wait{1, 0};
    if (!on_the_way.empty()) {
      const auto left = std::max<std::chrono::nanoseconds>(on_the_way.front().due - Clock::now(),
                                                           std::chrono::nanoseconds(0));
      wait = {left.count() / std::nano::den, left.count() % std::nano::den};
    }
    check(::ppoll(ready.data(), ready.size(), &wait, nullptr), "poll");
    for (std::size_t i = 0; i < ends.size(); ++i) take(ends[i], ends[1 - i], delay, on_the_way);
    for (; !on_the_way.empty() && on_the_way.front().due <= Clock::now(); on_the_way.pop_front()) {
      // An interface that is down loses it, as a cable would.
      const Packet& packet = on_the_way.front();
      if (::write(packet.to, packet.bytes.data(), packet.bytes.size()) < 0) continue;
    }
  }
}

}  // namespace orbbuf::bench
