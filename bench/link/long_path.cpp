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
#include <fstream>
#include <optional>
#include <random>
#include <stdexcept>
#include <utility>
#include <vector>

#include "bench/plain_socket.hpp"

namespace orbbuf::bench {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kLargestPacket = 65536;

constexpr std::size_t kHeldBytes = 500'000;      // 2 s at 2 Mbit/s
constexpr std::size_t kOpportunityBytes = 1500;  // as mahimahi has it
constexpr std::chrono::milliseconds kReorderDelay{10};
constexpr std::size_t kHeaderBytes = 60;  // of IPv4 and TCP, with our options or fewer

using Bytes = std::vector<char>;

struct Packet {
  Clock::time_point due;
  int to = -1;
  Bytes bytes;
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

/// The moments at which a recorded link took a packet, again and again.
class Opportunities {
 public:
  explicit Opportunities(const std::string& file) {
    std::ifstream in(file);
    for (int at = 0; in >> at;) at_.emplace_back(at);
    if (at_.empty()) throw std::runtime_error("no times of packets in " + file);
  }
  Clock::time_point next() const { return begin_ + at_[index_]; }
  void pass() {
    if (++index_ < at_.size()) return;
    index_ = 0;
    begin_ += at_.back();
  }

 private:
  std::vector<std::chrono::milliseconds> at_;
  std::size_t index_ = 0;
  Clock::time_point begin_ = Clock::now();
};

/// Packets between two interfaces, of which those from the first may wait for a recorded link.
class Path {
 public:
  Path(const std::array<int, 2>& ends, std::chrono::nanoseconds delay, const std::string& trace,
       const PacketFaults& faults)
      : ends_(ends), delay_(delay), faults_(faults) {
    if (!trace.empty()) opportunities_.emplace(trace);
  }

  /// Once something is to be done.
  void step() {
    std::array<pollfd, 2> ready{{{ends_[0], POLLIN, 0}, {ends_[1], POLLIN, 0}}};
    const timespec wait = until_next();
    check(::ppoll(ready.data(), ready.size(), &wait, nullptr), "poll");
    take(0);
    take(1);
    release();
    deliver();
  }

 private:
  timespec until_next() const {
    auto next = Clock::now() + std::chrono::seconds(1);
    if (!on_the_way_.empty()) next = std::min(next, on_the_way_.front().due);
    if (!held_.empty()) next = std::min(next, opportunities_->next());
    const auto left =
        std::max<std::chrono::nanoseconds>(next - Clock::now(), std::chrono::nanoseconds(0));
    return {left.count() / std::nano::den, left.count() % std::nano::den};
  }

  /// All that this end has by now.
  void take(std::size_t end) {
    std::array<char, kLargestPacket> bytes;
    for (;;) {
      const ssize_t size = ::read(ends_[end], bytes.data(), bytes.size());
      if (size <= 0) return;
      Bytes packet(bytes.data(), bytes.data() + size);
      if (end == 1 || !opportunities_) {
        send({Clock::now() + delay_, ends_[1 - end], std::move(packet)});
      } else if (held_bytes_ + packet.size() <= kHeldBytes) {
        held_bytes_ += packet.size();
        held_.push_back(std::move(packet));
      }
    }
  }

  /// What the recorded link has taken by now.
  void release() {
    if (!opportunities_) return;
    const auto now = Clock::now();
    for (; opportunities_->next() <= now; opportunities_->pass()) {
      room_ += kOpportunityBytes;  // a packet may take several, and share one
      for (; !held_.empty() && held_.front().size() <= room_; held_.pop_front()) {
        room_ -= held_.front().size();
        held_bytes_ -= held_.front().size();
        send({now + delay_, ends_[1], std::move(held_.front())});
      }
      if (held_.empty()) room_ = 0;
    }
  }

  bool happens(double share) { return share > 0 && chance_(random_) < share; }

  void send(Packet packet) {
    if (packet.bytes.size() > 2 * kHeaderBytes && happens(faults_.flip)) flip(packet.bytes);
    if (happens(faults_.reorder)) packet.due += kReorderDelay;
    if (happens(faults_.repeat)) put(packet);
    put(std::move(packet));
  }

  /// In the order of time.
  void put(Packet packet) {
    const auto later = std::upper_bound(
        on_the_way_.begin(), on_the_way_.end(), packet.due,
        [](Clock::time_point due, const Packet& other) { return due < other.due; });
    on_the_way_.insert(later, std::move(packet));
  }

  /// At even offsets from the TCP header, whose length is a multiple of four.
  void flip(Bytes& bytes) {
    const std::size_t words = (bytes.size() - kHeaderBytes) / 2;
    std::uniform_int_distribution<std::size_t> any(0, words - 1);
    const auto at = [&](std::size_t word) {
      return bytes.begin() + static_cast<std::ptrdiff_t>(kHeaderBytes + 2 * word);
    };
    const auto one = at(any(random_));
    std::swap_ranges(one, one + 2, at(any(random_)));
  }

  void deliver() {
    for (; !on_the_way_.empty() && on_the_way_.front().due <= Clock::now();
         on_the_way_.pop_front()) {
      // An interface that is down loses it, as a cable would.
      const Packet& packet = on_the_way_.front();
      if (::write(packet.to, packet.bytes.data(), packet.bytes.size()) < 0) continue;
    }
  }

  const std::array<int, 2> ends_;
  const std::chrono::nanoseconds delay_;
  const PacketFaults faults_;
  std::minstd_rand random_;
  std::uniform_real_distribution<double> chance_{0, 1};
  std::optional<Opportunities> opportunities_;
  std::deque<Bytes> held_;  // from the first end, until the recorded link takes it
  std::size_t held_bytes_ = 0;
  std::size_t room_ = 0;
  std::deque<Packet> on_the_way_;
};

}  // namespace

void carry_packets(const std::string& near_end, const std::string& far_end,
                   std::chrono::nanoseconds delay, const std::string& trace,
                   const PacketFaults& faults) {
  Path path({make_interface(near_end), make_interface(far_end)}, delay, trace, faults);
  std::fprintf(stderr, "path from %s to %s\n", near_end.c_str(), far_end.c_str());
  for (;;) path.step();
}

}  // namespace orbbuf::bench
