// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <set>
#include <string>

#include "common/service_status.hpp"
#include "common/wire.hpp"
#include "daemon/net/sender.hpp"

namespace orbbuf {

/// Reports the daemon's state to the service manager. It is ready once a frame has been captured
/// and the first attempt to connect has ended, with or without success. It feeds the watchdog while
/// every watched thread has called beat() within the last half of the watchdog's period. A missing
/// camera or server does not stop the feeding. Thread-bound to `main`.
class Health {
 public:
  using Clock = std::chrono::steady_clock;

  /// `service` must outlive it.
  explicit Health(ServiceStatus& service);

  void report(const wire::Report& report, const Sender& sender);

 private:
  void tell(const wire::Report& report, const Sender& sender);
  void feed_if_moving();

  ServiceStatus& service_;
  const std::chrono::nanoseconds watchdog_;  // 0: none
  std::set<std::string> still_;              // threads, and logged
  wire::Stats reported_;                     // at reported_time_
  Clock::time_point reported_time_ = Clock::now();
};

}  // namespace orbbuf
