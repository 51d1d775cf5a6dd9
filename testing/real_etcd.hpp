// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "testing/process.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::test {

/// A real etcd of one member, on free loopback ports and in a folder of its own; or, if the
/// environment's ORBBUF_ETCD_MODEL names it, the simulator's model of it, which must not differ.
class RealEtcd {
 public:
  /// Whether there is one.
  static bool is_installed();

  /// Throws std::runtime_error if it does not begin.
  RealEtcd();

  std::uint16_t port() const { return port_; }
  std::string endpoint() const { return "127.0.0.1:" + std::to_string(port_); }
  /// It answers nothing until resume().
  void pause() const;
  void resume() const;
  /// kill -9, and with the same keys and port again.
  void kill();
  void start();

 private:
  TemporaryFolder folder_;
  std::uint16_t port_ = 0;
  std::uint16_t peer_port_ = 0;
  std::unique_ptr<Process> process_;
};

/// Ports that nobody listens on at the moment.
std::vector<std::uint16_t> free_ports(std::size_t count);

}  // namespace orbbuf::test
