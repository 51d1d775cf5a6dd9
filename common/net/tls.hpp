// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>

#include "common/config.hpp"

namespace boost::asio::ssl {
class context;
}

namespace orbbuf {

/// `[tls]` of both configurations: all three are set, or none.
struct TlsSettings {
  std::filesystem::path certificate;  ///< PEM: our own, then the intermediate ones
  std::filesystem::path key;          ///< PEM: its private key, not readable by other users
  std::filesystem::path ca;           ///< PEM: the CA that signs the peer's certificate

  bool is_on() const { return !certificate.empty(); }

  friend bool operator==(const TlsSettings&, const TlsSettings&) = default;
};

using TlsContext = boost::asio::ssl::context;

/// Reads tls.certificate, tls.key and tls.ca: paths, or `credential:NAME` for a file in systemd's
/// $CREDENTIALS_DIRECTORY. Throws ConfigError if only some are set.
void load_tls(ConfigReader& config, TlsSettings& tls);

/// A context for TLS 1.3 only, in which each end requires and checks the other's certificate; null
/// if `tls` is off. Throws std::runtime_error that names the file and the reason: the file is
/// missing or not PEM, other users can read the key, the key does not match the certificate, the
/// certificate has expired or is not valid yet. is_robot: that is logged, and no error, for a robot
/// captures also while its clock is wrong.
std::shared_ptr<TlsContext> make_tls_context(const TlsSettings& tls, bool is_robot = false);

/// For SIGHUP: a context of the files as they are now, for new connections; null if `tls` is off or
/// the files cannot be used. Logs which of them.
std::shared_ptr<TlsContext> reload_tls_context(const TlsSettings& tls);

}  // namespace orbbuf
