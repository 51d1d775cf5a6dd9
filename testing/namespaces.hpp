// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace orbbuf::test {

/// Two hosts, `robot` and `server`, with a cable between them: network namespaces of this machine,
/// removed at the end of life. Only root can make them.
class Namespaces {
 public:
  Namespaces();
  ~Namespaces();
  Namespaces(const Namespaces&) = delete;
  Namespaces& operator=(const Namespaces&) = delete;

  /// False: could not be made; why() says what failed.
  bool exist() const { return why_.empty(); }
  const std::string& why() const { return why_; }

  /// Words to put before a command that is to run on that host.
  std::vector<std::string> on_robot() const { return {"ip", "netns", "exec", robot_}; }
  std::vector<std::string> on_server() const { return {"ip", "netns", "exec", server_}; }
  /// The server host's address; any port.
  static constexpr const char* kServerListen = "10.77.0.2:0";

  /// Loses every packet at the receiving side: the server hears nothing, and nothing is refused.
  void cut_link() const;
  void mend_link() const;

 private:
  std::string robot_;
  std::string server_;
  std::string why_;
};

}  // namespace orbbuf::test
