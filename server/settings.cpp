// SPDX-License-Identifier: Apache-2.0
#include "server/settings.hpp"

#include <spdlog/fmt/fmt.h>

#include <array>
#include <string_view>
#include <utility>

#include "common/wire.hpp"

namespace orbbuf {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;

constexpr std::uint64_t kKiB = 1024;
constexpr std::uint64_t kGiB = kKiB * kKiB * kKiB;
constexpr auto kShortest = milliseconds(10);

/// The host is resolved only when it is listened on.
void load_address(ConfigReader& reader, Address& address) {
  constexpr std::string_view kKey = "listen.address";
  auto parsed = parse_address(reader.text(kKey, to_string(address)));
  if (!parsed) reader.fail(kKey, parsed.error().text);
  address = std::move(parsed).value();
}

std::size_t load_count(ConfigReader& reader, std::string_view key, std::size_t fallback) {
  constexpr std::int64_t kMost = 100'000;
  return static_cast<std::size_t>(
      reader.integer(key, static_cast<std::int64_t>(fallback), 1, kMost));
}

void load_admission(ConfigReader& reader, ListenSettings& listen) {
  load_tls(reader, listen.tls);
  listen.insecure = reader.flag("listen.insecure", listen.insecure);
  if (!listen.tls.is_on() && !listen.insecure && !is_loopback(listen.address)) {
    reader.fail("listen.address",
                fmt::format("{} can be reached from the network: set up [tls] (docs/security.md), "
                            "or say listen.insecure = true to let anybody in",
                            to_string(listen.address)));
  }
  listen.robots = reader.texts("listen.robots");
  for (const std::string& id : listen.robots) {
    if (wire::is_valid_id(id)) continue;
    reader.fail("listen.robots", "not a robot id: \"" + id + "\"");
  }
}

void load_listen(ConfigReader& reader, ListenSettings& listen) {
  load_address(reader, listen.address);
  load_admission(reader, listen);
  listen.max_robots = load_count(reader, "listen.max_robots", listen.max_robots);
  listen.max_connections = load_count(reader, "listen.max_connections", listen.max_connections);
  listen.max_connections_per_address =
      load_count(reader, "listen.max_connections_per_address", listen.max_connections_per_address);
  listen.hello_timeout =
      reader.duration("listen.hello_timeout", listen.hello_timeout, kShortest, hours(1));
  listen.idle_timeout =
      reader.duration("listen.idle_timeout", listen.idle_timeout, kShortest, hours(24));
  listen.max_frame_bytes = static_cast<std::uint32_t>(
      reader.bytes("listen.max_frame", listen.max_frame_bytes, kKiB, kGiB));
  listen.receive_buffer_bytes = static_cast<std::uint32_t>(
      reader.bytes("listen.receive_buffer", listen.receive_buffer_bytes, 0, kGiB));
}

void load_sinks(ConfigReader& reader, SinkSettings& sinks) {
  constexpr std::array<std::string_view, 2> kFormats{"pgm", "mjpeg"};
  sinks.files_enabled = reader.flag("files.enabled", sinks.files_enabled);
  sinks.files_path = reader.path("files.path", sinks.files_path);
  if (sinks.files_path.empty()) reader.fail("files.path", "must not be empty");
  sinks.mcap_enabled = reader.flag("mcap.enabled", sinks.mcap_enabled);
  sinks.fifo = reader.path("pipe.fifo", sinks.fifo);
  sinks.command = reader.text("pipe.command", sinks.command);
  sinks.pipe_format = reader.choice("pipe.format", kFormats[0], kFormats) == kFormats[0]
                          ? PipeFormat::kPgm
                          : PipeFormat::kMjpeg;
  if (!sinks.fifo.empty() && !sinks.command.empty()) {
    reader.fail("pipe.command", "excludes pipe.fifo: a session has one pipe");
  }
  if (!sinks.files_enabled && !sinks.mcap_enabled && sinks.fifo.empty() && sinks.command.empty()) {
    reader.fail("files.enabled", "frames need a sink: files, mcap, pipe.fifo or pipe.command");
  }
}

}  // namespace

Settings load_settings(ConfigReader& reader) {
  constexpr std::array<std::string_view, 5> kLevels{"trace", "debug", "info", "warn", "error"};
  Settings settings;
  settings.log_level = reader.choice("log.level", settings.log_level, kLevels);
  load_listen(reader, settings.listen);
  settings.session_timeout =
      reader.duration("session.timeout", settings.session_timeout, kShortest, hours(24 * 365));
  settings.drain_timeout =
      reader.duration("session.drain_timeout", settings.drain_timeout, milliseconds(0), hours(1));
  load_sinks(reader, settings.sinks);
  reader.reject_unknown();
  return settings;
}

}  // namespace orbbuf
