// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fleet_metrics.hpp"

#include <fmt/core.h>

#include <string_view>

#include "common/seconds.hpp"

namespace orbbuf::fleet {
namespace {

void add(std::string& text, std::string_view name, std::string_view help, double value) {
  const bool is_counter = name.ends_with("_total");
  text += fmt::format(
      "# HELP orbbuf_fleet_{0} {1}\n# TYPE orbbuf_fleet_{0} {2}\norbbuf_fleet_{0} {3}\n", name,
      help, is_counter ? "counter" : "gauge", value);
}

}  // namespace

std::string to_prometheus(const Fleet& fleet) {
  const auto count = [](std::uint64_t number) { return static_cast<double>(number); };
  const EtcdChannel& etcd = fleet.channel();
  const PositionRecorder& recorder = fleet.recorder();
  std::string text;
  add(text, "servers", "Servers whose lease lives, this one included",
      count(fleet.membership().servers().size()));
  add(text, "draining", "1: this server sends its robots away", fleet.is_draining() ? 1 : 0);
  add(text, "take_overs_total", "Sessions taken over from another server or process",
      count(fleet.ownership().take_overs()));
  add(text, "epoch_conflicts_total", "Positions not recorded: the session was another server's",
      count(recorder.conflicts()));
  add(text, "positions_total", "Positions recorded", count(recorder.records()));
  add(text, "record_requests_total", "Requests that recorded positions",
      count(recorder.requests()));
  add(text, "record_seconds_total", "Time that these took", to_seconds(recorder.time_spent()));
  add(text, "etcd_requests_total", "Requests to etcd", count(etcd.requests()));
  add(text, "etcd_failures_total", "Requests that an endpoint did not answer",
      count(etcd.failures()));
  add(text, "etcd_seconds_total", "Time that answered requests took",
      to_seconds(etcd.time_spent()));
  return text;
}

}  // namespace orbbuf::fleet
