// SPDX-License-Identifier: Apache-2.0
#include "common/service_status.hpp"

#include <algorithm>
#include <cstdint>
#include <system_error>
#include <utility>

#ifdef ORBBUF_SYSTEMD
#include <systemd/sd-daemon.h>

#include "common/log.hpp"
#endif

namespace orbbuf {

std::chrono::microseconds ServiceStatus::watchdog() const {
  std::uint64_t period_us = 0;
#ifdef ORBBUF_SYSTEMD
  if (::sd_watchdog_enabled(0, &period_us) <= 0) return {};
#endif
  return std::chrono::microseconds(period_us);
}

std::chrono::microseconds ServiceStatus::interval() const {
  constexpr std::chrono::microseconds kLongest = std::chrono::seconds(1);
  const auto period = watchdog();
  return period.count() == 0 ? kLongest : std::min(kLongest, period / 4);
}

void ServiceStatus::ready() {
  if (!std::exchange(is_ready_, true)) notify("READY=1");
}

void ServiceStatus::status(const std::string& text) {
  if (text != status_) notify("STATUS=" + text);
  status_ = text;
}

void ServiceStatus::notify([[maybe_unused]] const std::string& message) {
#ifdef ORBBUF_SYSTEMD
  const int result = ::sd_notify(0, message.c_str());
  if (result >= 0 || std::exchange(has_failed_, true)) return;
  log_warn("cannot notify systemd of \"{}\": {}", message,
           std::generic_category().message(-result));
#endif
}

}  // namespace orbbuf
