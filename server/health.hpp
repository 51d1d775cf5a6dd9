// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <string>

#include "common/service_status.hpp"
#include "server/link/listener.hpp"

namespace orbbuf {

/// Tells the service manager how the server does. Ready: from start() on. Fed: each time that a
/// message has gone from `main` to the `files` pool and back. So a `main` that is stuck is noticed,
/// and a disk on which all threads of the pool are; one slow session is not a reason to restart the
/// server. Thread-bound to `main`.
class Health {
 public:
  /// All must outlive it, and its run of `main`.
  Health(boost::asio::io_context& main, boost::asio::thread_pool& files, ServiceStatus& service,
         const Listener& listener);

  void start();
  /// Nothing more is told, and no timer is left in `main`.
  void stop();

 private:
  void report();
  void ask_files();

  boost::asio::io_context& main_;
  boost::asio::thread_pool& files_;
  ServiceStatus& service_;
  const Listener& listener_;
  const std::string address_;
  boost::asio::steady_timer timer_;
  const std::chrono::microseconds interval_;
  bool is_asking_ = false;
  bool is_stopped_ = false;
};

}  // namespace orbbuf
