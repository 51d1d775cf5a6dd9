// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace orbbuf::test {

/// Two hosts, `robot` and `server`, with a cable between them, or two: network namespaces of this
/// machine, removed at the end of life. Only root can make them.
class Namespaces {
 public:
  /// The cables' interfaces, on both hosts.
  static constexpr const char* kLink = "wire";
  static constexpr const char* kSecondLink = "wire2";

  /// links: 1 or 2.
  explicit Namespaces(int links = 1);
  ~Namespaces();
  Namespaces(const Namespaces&) = delete;
  Namespaces& operator=(const Namespaces&) = delete;

  /// False: could not be made; why() says what failed.
  bool exist() const { return why_.empty(); }
  const std::string& why() const { return why_; }

  /// Words to put before a command that is to run on that host.
  std::vector<std::string> on_robot() const { return {"ip", "netns", "exec", robot_}; }
  std::vector<std::string> on_server() const { return {"ip", "netns", "exec", server_}; }
  /// The server host's address on the first cable; any port.
  static constexpr const char* kServerListen = "10.77.0.2:0";
  /// With two links, an address that the robot reaches over either, the first one by default.
  static constexpr const char* kServerListenOnBoth = "10.79.0.2:0";

  /// Loses every packet at the receiving side: the server hears nothing, and nothing is refused.
  void cut_link(const std::string& link = kLink) const;
  void mend_link(const std::string& link = kLink) const;

  /// From here on the robot sends at most that much over the first cable, e.g. "2mbit"; 100 ms of
  /// it wait in the cable.
  void shape_link(const std::string& rate) const;

 private:
  using Steps = std::vector<std::vector<std::string>>;

  Steps cable(const std::string& name, const std::string& network) const;
  void take(const Steps& steps);
  void nft(const std::string& words) const;

  std::string robot_;
  std::string server_;
  std::string why_;
};

}  // namespace orbbuf::test
