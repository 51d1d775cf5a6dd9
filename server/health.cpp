// SPDX-License-Identifier: Apache-2.0
#include "server/health.hpp"

#include <fmt/core.h>

#include <boost/asio/post.hpp>
#include <utility>

#include "server/runtime/listen_on.hpp"

namespace orbbuf {
namespace asio = boost::asio;

Health::Health(asio::io_context& main, asio::thread_pool& files, ServiceStatus& service,
               const Listener& listener)
    : main_(main),
      files_(files),
      service_(service),
      listener_(listener),
      address_(to_text(listener.endpoint())),
      timer_(main),
      interval_(service.interval()) {}

void Health::start() {
  service_.ready();
  report();
}

void Health::stop() {
  is_stopped_ = true;
  timer_.cancel();
}

void Health::report() {
  if (is_stopped_) return;
  service_.status(
      fmt::format("listening on {}; robots connected: {}", address_, listener_.robots()));
  if (!std::exchange(is_asking_, true)) ask_files();
  timer_.expires_after(interval_);
  timer_.async_wait([this](const boost::system::error_code& /*error*/) { report(); });
}

void Health::ask_files() {
  asio::post(files_, [this] {
    asio::post(main_, [this] {
      is_asking_ = false;
      service_.feed();
    });
  });
}

}  // namespace orbbuf
