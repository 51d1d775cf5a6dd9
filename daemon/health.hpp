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

/// Tells the service manager how the robot does. Ready: frames come, and the first attempt to
/// connect has ended, well or not. Fed: `main`, by calling this, and every watched thread of the
/// pipeline have got round in the last half of the watchdog's period. A camera that is away and a
/// server that is not there are no reason not to be fed. Thread-bound to `main`.
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
  wire::Stats told_;                         // at told_time_
  Clock::time_point told_time_ = Clock::now();
};

}  // namespace orbbuf
