// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

namespace orbbuf {

/// Notifies the service manager by sd_notify(3), for a unit of Type=notify. Does nothing if
/// $NOTIFY_SOCKET is not set or the program was built without libsystemd. Never waits and never
/// throws: the first message that cannot be sent is logged. Thread-bound to `main`.
class ServiceStatus {
 public:
  /// The unit's WatchdogSec=: how long the manager waits for feed() before it kills this process.
  /// Zero: the manager does not watch this process.
  std::chrono::microseconds watchdog() const;
  /// How often to call the others: each second, or more often for a short watchdog.
  std::chrono::microseconds interval() const;

  /// READY=1: the service works. Only the first call counts.
  void ready();
  /// STATUS=: one line for `systemctl status`. Sent if it has changed.
  void status(const std::string& text);
  /// WATCHDOG=1: every watched thread is alive.
  void feed() { notify("WATCHDOG=1"); }
  /// STOPPING=1: shutdown has begun.
  void stopping() { notify("STOPPING=1"); }

 private:
  void notify(const std::string& message);

  bool is_ready_ = false;
  std::string status_;
  bool has_failed_ = false;
};

}  // namespace orbbuf
