// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/address.hpp"
#include "common/config.hpp"
#include "common/net/tls.hpp"
#include "server/live/control_socket.hpp"
#include "server/retention/quota.hpp"
#include "server/sink/make_sinks.hpp"

namespace orbbuf {

/// What the server listens on, and what it allows there.
struct ListenSettings {
  Address address{"127.0.0.1", 7722};  ///< port 0: any free one
  TlsSettings tls;                     ///< `[tls]`
  bool insecure = false;               ///< plain TCP is wanted though not only we can connect
  std::vector<std::string> robots;     ///< ids of those that may connect; empty: all
  std::size_t max_robots = 256;
  std::size_t max_connections = 1024;
  std::size_t max_connections_per_address = 64;
  std::chrono::nanoseconds hello_timeout = std::chrono::seconds(5);
  std::chrono::nanoseconds idle_timeout = std::chrono::seconds(10);
  std::uint32_t max_frame_bytes = 16 * 1024 * 1024;
  std::uint32_t receive_buffer_bytes = 0;  ///< per connection; 0: the kernel's choice

  friend bool operator==(const ListenSettings&, const ListenSettings&) = default;
};

/// The server's configuration; config/orbbuf-server.toml explains each key.
struct Settings {
  std::string log_level = "info";
  ListenSettings listen;
  std::string status_socket = kAutomaticSocket;  ///< "": none
  std::optional<Address> http_address;           ///< of the live page; nothing: there is none
  std::chrono::nanoseconds session_timeout = std::chrono::minutes(10);
  std::chrono::nanoseconds drain_timeout = std::chrono::seconds(2);
  SinkSettings sinks;
  Quota quota;  ///< of sinks.files_path, for each robot

  friend bool operator==(const Settings&, const Settings&) = default;
};

/// Reads every key, defaults as above, and refuses unknown ones. Throws ConfigError.
Settings load_settings(ConfigReader& reader);

}  // namespace orbbuf
