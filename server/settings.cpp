// SPDX-License-Identifier: Apache-2.0
#include "server/settings.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <string_view>
#include <utility>

#include "common/log.hpp"
#include "common/wire.hpp"

namespace orbbuf {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;

constexpr std::uint64_t kKiB = 1024;
constexpr std::uint64_t kGiB = kKiB * kKiB * kKiB;
constexpr auto kShortest = milliseconds(10);
constexpr std::int64_t kMostOfAKind = 100'000;

/// The host is resolved only when it is listened on.
Address to_address(const ConfigReader& reader, std::string_view key, const std::string& text) {
  auto parsed = parse_address(text);
  if (!parsed) reader.fail(key, parsed.error().text);
  return std::move(parsed).value();
}

/// Off this machine the link and the page need TLS, or the administrator's explicit consent.
void require_admission(const ConfigReader& reader, std::string_view key, const Address& address,
                       const ListenSettings& listen) {
  if (listen.tls.is_on() || listen.insecure || is_loopback(address)) return;
  reader.fail(key,
              fmt::format("{} can be reached from the network: set up [tls] (docs/security.md), "
                          "or set listen.insecure = true to accept any host",
                          to_string(address)));
}

void load_admission(ConfigReader& reader, ListenSettings& listen) {
  load_tls(reader, listen.tls);
  reader.read("listen.insecure", listen.insecure);
  require_admission(reader, "listen.address", listen.address, listen);
  listen.robots = reader.texts("listen.robots");
  for (const std::string& id : listen.robots) {
    if (wire::is_valid_id(id)) continue;
    reader.fail("listen.robots", "not a robot id: \"" + id + "\"");
  }
}

void load_listen(ConfigReader& reader, ListenSettings& listen) {
  constexpr std::string_view kAddress = "listen.address";
  listen.address = to_address(reader, kAddress, reader.text(kAddress, to_string(listen.address)));
  load_admission(reader, listen);
  reader.read("listen.max_robots", listen.max_robots, 1, kMostOfAKind);
  reader.read("listen.max_connections", listen.max_connections, 1, kMostOfAKind);
  reader.read("listen.max_connections_per_address", listen.max_connections_per_address, 1,
              kMostOfAKind);
  reader.read("listen.hello_timeout", listen.hello_timeout, kShortest, hours(1));
  reader.read("listen.idle_timeout", listen.idle_timeout, kShortest, hours(24));
  reader.read_bytes("listen.max_frame", listen.max_frame_bytes, kKiB, kGiB);
  reader.read_bytes("listen.receive_buffer", listen.receive_buffer_bytes, 0, kGiB);
}

/// `names` are those of Value's enumerators, in their order.
template <class Value>
Value load_choice(ConfigReader& reader, const std::string& key, Value fallback,
                  std::span<const std::string_view> names) {
  const auto got = reader.choice(key, names[static_cast<std::size_t>(fallback)], names);
  return static_cast<Value>(std::ranges::find(names, got) - names.begin());
}

constexpr std::array<std::string_view, 3> kSyncs{"ack", "1 s", "off"};
constexpr std::array<std::string_view, 2> kFormats{"pgm", "mjpeg"};
constexpr std::array<std::string_view, 3> kRestarts{"always", "on-failure", "never"};
constexpr std::array<std::string_view, 2> kResumes{"live", "backlog"};

/// `table`, with what it does not say taken from `fallback`; of `command` and `fifo`, which are one
/// choice, from there only if it says neither.
SlamSettings load_slam(ConfigReader& reader, const std::string& table,
                       const SlamSettings& fallback) {
  const std::string command = table + ".command";
  const std::string fifo = table + ".fifo";
  SlamSettings slam = fallback;
  if (reader.has(command) || reader.has(fifo)) slam.command = slam.fifo = "";
  reader.read(command, slam.command);
  reader.read(fifo, slam.fifo);
  slam.format = load_choice(reader, table + ".format", slam.format, kFormats);
  slam.restart = load_choice(reader, table + ".restart", slam.restart, kRestarts);
  slam.resume = load_choice(reader, table + ".resume", slam.resume, kResumes);
  if (!slam.fifo.empty() && !slam.command.empty()) {
    reader.fail(command, "excludes fifo: a session has one pipe");
  }
  return slam;
}

void check_slam(const ConfigReader& reader, const std::string& table, const SlamSettings& slam,
                const SinkSettings& sinks) {
  const bool is_kept = sinks.is_kept();
  if (!slam.is_on() && !is_kept && !sinks.ros.enabled && !sinks.dds.enabled) {
    const auto text =
        fmt::format("frames need a sink: files, mcap, {0}.command, {0}.fifo, ros or dds", table);
    reader.fail("files.enabled", text);
  }
  if (!slam.command.empty() && slam.restart != Restart::kAlways && !is_kept) {
    reader.fail(table + ".restart",
                "without files or mcap only \"always\": the robot's stream would stay paused");
  }
  if (slam.is_on() && slam.resume == Resume::kBacklog && !sinks.files_enabled) {
    reader.fail(table + ".resume", "\"backlog\" needs files.enabled = true");
  }
}

void load_http(ConfigReader& reader, Settings& settings) {
  constexpr std::string_view kAddress = "http.address";
  const std::string text = reader.text(kAddress, "");
  if (text.empty()) return;
  settings.http_address = to_address(reader, kAddress, text);
  require_admission(reader, kAddress, *settings.http_address, settings.listen);
}

void load_status(ConfigReader& reader, std::string& socket) {
  constexpr std::string_view kSocket = "status.socket";
  socket = reader.text(kSocket, socket);
  if (socket != kAutomaticSocket) socket = reader.path(kSocket, socket).string();
}

std::string load_frame_id(ConfigReader& reader, const std::string& key,
                          const std::string& fallback) {
  std::string id = reader.text(key, fallback);
  if (id.empty()) reader.fail(key, "must not be empty");
  return id;
}

constexpr double kSlowestPace = 1.1;  // with less, frames that are late stay so
constexpr double kFastestPace = 1000;

void load_ros(ConfigReader& reader, RosSettings& ros) {
  constexpr std::int64_t kMostQueued = 100'000;
  ros.frame_id = load_frame_id(reader, "ros.frame_id", ros.frame_id);
  reader.read("ros.queue", ros.queue, 1, kMostQueued);
  reader.read("ros.pace", ros.pace, kSlowestPace, kFastestPace);
  reader.read("ros.wait_for_subscriber", ros.wait_for_subscriber, {}, std::chrono::hours{1});
  reader.read("ros.enabled", ros.enabled);
#ifndef ORBBUF_ROS
  if (ros.enabled) {
    reader.fail("ros.enabled", "this server was built without ROS (cmake -DORBBUF_WITH_ROS=ON)");
  }
#endif
}

void load_sinks(ConfigReader& reader, SinkSettings& sinks) {
  reader.read("files.enabled", sinks.files_enabled);
  reader.read("files.path", sinks.files_path);
  if (sinks.files_path.empty()) reader.fail("files.path", "must not be empty");
  sinks.files_sync = load_choice(reader, "files.sync", sinks.files_sync, kSyncs);
  reader.read("mcap.enabled", sinks.mcap_enabled);
  reader.read("mcap.split", sinks.mcap_split, milliseconds(0), hours(24 * 365));
  load_ros(reader, sinks.ros);
  sinks.dds.frame_id = load_frame_id(reader, "dds.frame_id", sinks.dds.frame_id);
  reader.read("dds.pace", sinks.dds.pace, kSlowestPace, kFastestPace);
  reader.read("dds.enabled", sinks.dds.enabled);
#ifndef ORBBUF_DDS
  if (sinks.dds.enabled) {
    reader.fail("dds.enabled", "this server was built without DDS (cmake -DORBBUF_WITH_DDS=ON)");
  }
#endif
  sinks.slam = load_slam(reader, "slam", sinks.slam);
  check_slam(reader, "slam", sinks.slam, sinks);
  for (const auto& [robot, table] : reader.tables("robot")) {
    if (!wire::is_valid_id(robot)) reader.fail(table, "not a robot id");
    const std::string key = table + ".slam";
    sinks.slam_of[robot] = load_slam(reader, key, sinks.slam);
    check_slam(reader, key, sinks.slam_of[robot], sinks);
  }
}

void load_quota(ConfigReader& reader, Quota& quota) {
  constexpr auto kMost = std::numeric_limits<std::int64_t>::max();
  reader.read_bytes("files.keep_size", quota.bytes, 0, kMost);
  reader.read("files.keep_time", quota.age, milliseconds(0), std::chrono::nanoseconds(kMost));
}

}  // namespace

Settings load_settings(ConfigReader& reader) {
  Settings settings;
  reader.read("log.level", settings.log_level, kLogLevels);
  load_listen(reader, settings.listen);
  load_http(reader, settings);
  load_status(reader, settings.status_socket);
  reader.read("session.timeout", settings.session_timeout, kShortest, hours(24 * 365));
  reader.read("session.drain_timeout", settings.drain_timeout, milliseconds(0), hours(1));
  load_sinks(reader, settings.sinks);
  load_quota(reader, settings.quota);
  reader.reject_unknown();
  return settings;
}

}  // namespace orbbuf
