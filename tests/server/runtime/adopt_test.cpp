// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/adopt.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>

#include <boost/asio/io_context.hpp>
#include <vector>

namespace orbbuf {
namespace {

/// An epoll descriptor that watches one that watches one and so on: the kernel refuses to watch it.
std::vector<UniqueFd> nested_epolls() {
  constexpr std::size_t kDeepest = 5;
  std::vector<UniqueFd> epolls;
  for (std::size_t depth = 0; depth < kDeepest; ++depth) {
    epolls.emplace_back(::epoll_create1(EPOLL_CLOEXEC));
    epoll_event event{};
    event.events = EPOLLIN;
    if (depth == 0) continue;
    EXPECT_EQ(::epoll_ctl(epolls[depth].get(), EPOLL_CTL_ADD, epolls[depth - 1].get(), &event), 0)
        << depth;
  }
  return epolls;
}

TEST(Adopt, TheDescriptorIsOwnedByTheOther) {
  boost::asio::io_context main;
  boost::asio::posix::stream_descriptor descriptor(main);
  UniqueFd fd(::eventfd(0, EFD_CLOEXEC));
  const int number = fd.get();
  EXPECT_FALSE(adopt(descriptor, std::move(fd), "it"));
  EXPECT_EQ(descriptor.native_handle(), number);
  EXPECT_NE(::fcntl(number, F_GETFD), -1);
}

TEST(Adopt, WhatTheKernelCannotWatchIsClosed) {
  boost::asio::io_context main;
  boost::asio::posix::stream_descriptor descriptor(main);
  auto epolls = nested_epolls();
  const int number = epolls.back().get();
  const auto error = adopt(descriptor, std::move(epolls.back()), "it");
  ASSERT_TRUE(error);
  EXPECT_THAT(error->text, testing::HasSubstr("watch it: "));
  EXPECT_FALSE(descriptor.is_open());
  EXPECT_EQ(::fcntl(number, F_GETFD), -1);
}

}  // namespace
}  // namespace orbbuf
