// SPDX-License-Identifier: Apache-2.0
#include "daemon/health.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "common/log.hpp"
#include "common/seconds.hpp"
#include "common/watched_thread.hpp"

namespace orbbuf {
namespace {

using std::chrono::nanoseconds;

constexpr std::chrono::seconds kTellInterval{1};

std::string describe(const ServerLink& link) {
  if (link.is_stalled()) return "stalled";
  if (link.is_connected()) return "connected to " + to_string(link.server());
  if (link.last_error().empty()) return "connecting";
  return "no connection: " + link.last_error();
}

}  // namespace

Health::Health(ServiceStatus& service) : service_(service), watchdog_(service.watchdog()) {}

void Health::report(const wire::Report& report, const Sender& sender) {
  if (Clock::now() >= reported_time_ + kTellInterval) tell(report, sender);
  if (report.stats.captured > 0 && sender.link().has_tried()) service_.ready();
  if (watchdog_ > nanoseconds(0)) feed_if_moving();
}

void Health::tell(const wire::Report& report, const Sender& sender) {
  const wire::Stats& stats = report.stats;
  const auto now = Clock::now();
  const double seconds = to_seconds(now - std::exchange(reported_time_, now));
  const wire::Stats before = std::exchange(reported_, stats);
  const auto rate = [seconds](std::uint64_t from, std::uint64_t to) {
    return static_cast<double>(to - std::min(from, to)) / seconds;
  };
  const auto spooled = sender.spooled();
  const auto samples = sender.samples().stats();
  service_.status(fmt::format(
      "{:.1f} frames/s captured, {:.1f} delivered; buffer {} of {}{}; link {}{}{}",
      rate(before.captured, stats.captured), rate(before.acknowledged, stats.acknowledged),
      stats.waiting, report.capacity, spooled ? fmt::format("; spool {}", *spooled) : "",
      describe(sender.link()), samples.empty() ? "" : "; ", samples));
}

void Health::feed_if_moving() {
  const auto limit = std::max<nanoseconds>(watchdog_ / 2, 2 * kBeatInterval);
  const auto still = WatchedThread::find_still(limit);
  std::set<std::string> names;
  for (const auto& [name, time] : still) {
    names.insert(name);
    if (still_.contains(name)) continue;
    log_error("thread {} has not responded for {:.1f} s; feeding the watchdog stops until it does",
              name, to_seconds(time));
  }
  still_ = std::move(names);
  if (still_.empty()) service_.feed();
}

}  // namespace orbbuf
