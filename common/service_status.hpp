// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

namespace orbbuf {

/// What the service manager is told of this process: sd_notify(3), for a unit of Type=notify. Where
/// there is none ($NOTIFY_SOCKET is not set), or the program was built without libsystemd, nothing
/// is told. Nothing waits, nothing throws: a message that cannot be sent is logged, once.
/// Thread-bound to `main`.
class ServiceStatus {
 public:
  /// The unit's WatchdogSec=: how long the manager waits for feed() before it kills this process.
  /// Zero: it does not watch, or not this process.
  std::chrono::microseconds watchdog() const;
  /// How often to call the others: each second, or more often for a short watchdog.
  std::chrono::microseconds interval() const;

  /// The service does what it is for. Only the first call counts.
  void ready();
  /// One line for `systemctl status`. Sent if it has changed.
  void status(const std::string& text);
  /// All that has to go on goes on.
  void feed();
  /// The end has begun.
  void stopping();

 private:
  void tell(const std::string& message);

  bool is_ready_ = false;
  std::string status_;
  bool has_failed_ = false;
};

}  // namespace orbbuf
