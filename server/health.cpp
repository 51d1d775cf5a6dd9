// SPDX-License-Identifier: Apache-2.0
#include "server/health.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <utility>

namespace orbbuf {
namespace asio = boost::asio;
using std::chrono::nanoseconds;

namespace {

constexpr std::chrono::seconds kInterval{1};

nanoseconds interval_for(nanoseconds watchdog) {
  return watchdog == nanoseconds(0) ? kInterval : std::min<nanoseconds>(kInterval, watchdog / 4);
}

}  // namespace

Health::Health(asio::io_context& main, asio::thread_pool& files, ServiceStatus& service,
               const Listener& listener)
    : main_(main),
      files_(files),
      service_(service),
      listener_(listener),
      address_(to_text(listener.endpoint())),
      timer_(main),
      interval_(interval_for(service.watchdog())) {}

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
