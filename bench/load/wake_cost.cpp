// SPDX-License-Identifier: Apache-2.0
#include "bench/load/wake_cost.hpp"

#include <sys/epoll.h>
#include <sys/eventfd.h>

#include <ctime>
#include <stdexcept>
#include <thread>

#include "common/unique_fd.hpp"

namespace orbbuf::load {
namespace {

constexpr int kWakes = 1000;
constexpr std::chrono::milliseconds kBetween{2};

std::chrono::nanoseconds own_cpu_time() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

}  // namespace

std::chrono::nanoseconds bare_wake_cost() {
  const UniqueFd bell(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  const UniqueFd poll(::epoll_create1(EPOLL_CLOEXEC));
  epoll_event event{};
  event.events = EPOLLIN;
  if (::epoll_ctl(poll.get(), EPOLL_CTL_ADD, bell.get(), &event) != 0) {
    throw std::runtime_error("epoll_ctl failed");
  }
  const std::jthread ringer([&bell](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      ::eventfd_write(bell.get(), 1);
      std::this_thread::sleep_for(kBetween);
    }
  });
  const auto before = own_cpu_time();
  for (int i = 0; i < kWakes; ++i) {
    ::epoll_wait(poll.get(), &event, 1, -1);
    eventfd_t rings = 0;
    ::eventfd_read(bell.get(), &rings);
  }
  return (own_cpu_time() - before) / kWakes;
}

}  // namespace orbbuf::load
