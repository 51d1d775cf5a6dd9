// SPDX-License-Identifier: Apache-2.0
#include "bench/strangers/crowd.hpp"

#include <algorithm>
#include <boost/asio/write.hpp>
#include <chrono>

namespace orbbuf::bench {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

constexpr std::chrono::milliseconds kTick{10};

}  // namespace

void Crowd::grow() {
  if (is_stopped_) return;
  const std::size_t most = options_.rate * kTick.count() / 1000;
  for (std::size_t i = 0; i < most && all_.size() < options_.size; ++i) connect();
  timer_.expires_after(kTick);
  timer_.async_wait([self = shared_from_this()](const error_code& aborted) {
    if (!aborted) self->grow();
  });
}

void Crowd::connect() {
  auto& io = static_cast<asio::io_context&>(timer_.get_executor().context());
  const auto one = std::make_shared<One>(io);
  const auto host = static_cast<std::uint32_t>(2 + count_ % kAddresses);
  error_code failed;
  one->socket.open(Tcp::v4(), failed);
  if (!failed) one->socket.bind({asio::ip::address_v4(0x7f000100U + host), 0}, failed);
  if (failed) return;
  ++count_;
  all_.push_back(one);
  one->socket.async_connect(options_.to,
                            [self = shared_from_this(), one](const error_code& refused) {
                              if (refused || self->is_stopped_) return self->leave(one);
                              one->words = self->options_.words();
                              asio::async_write(one->socket, asio::buffer(one->words),
                                                [self, one](const error_code& gone, std::size_t) {
                                                  gone ? self->leave(one) : self->read(one);
                                                });
                            });
}

void Crowd::read(const std::shared_ptr<One>& one) {
  one->socket.async_read_some(asio::buffer(one->answer), [self = shared_from_this(), one](
                                                             const error_code& gone, std::size_t) {
    gone || self->options_.leaves_when_answered ? self->leave(one) : self->read(one);
  });
}

void Crowd::leave(const std::shared_ptr<One>& one) {
  error_code ignored;  // it is closed either way
  one->socket.close(ignored);
  std::erase(all_, one);
}

void Crowd::stop() {
  is_stopped_ = true;
  timer_.cancel();
  const auto all = all_;  // one that leaves is removed from the original
  for (const auto& one : all) leave(one);
}

}  // namespace orbbuf::bench
