// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/net/tls.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::test {

/// Keys and certificates made by the openssl commands of docs/security.md, in a folder of their
/// own: a CA, a server on loopback, and the robot turtlebot1.
class Certificates {
 public:
  /// Throws std::runtime_error with what openssl says if a command fails.
  Certificates();

  TlsSettings server() const { return of("server"); }
  TlsSettings robot() const { return of("turtlebot1"); }
  /// NAME.crt and NAME.key of the folder, and its CA.
  TlsSettings of(const std::string& name) const;

  /// Runs the block `name` of the document again, with each `from` in it made `to`.
  void make(const std::string& name, const std::string& from, const std::string& to) const;

  /// Makes NAME.crt anew, by the same CA, as one that expired a day ago. openssl makes no such
  /// certificate since 3.5.
  void expire(const std::string& name) const;

  /// Words for the command line of either program that set `[tls]` to `tls`.
  static std::vector<std::string> overrides(const TlsSettings& tls);

 private:
  TemporaryFolder folder_;
};

}  // namespace orbbuf::test
