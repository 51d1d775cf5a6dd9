// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ssl/context.hpp>
#include <filesystem>
#include <memory>

#include "common/config.hpp"

namespace orbbuf {

/// `[tls]` of both configurations: all three are set, or none.
struct TlsSettings {
  std::filesystem::path certificate;  ///< PEM: our own, and those between it and the CA's
  std::filesystem::path key;          ///< PEM: its private key, not readable by everybody
  std::filesystem::path ca;           ///< PEM: whose signature the other end's must bear

  bool is_on() const { return !certificate.empty(); }

  friend bool operator==(const TlsSettings&, const TlsSettings&) = default;
};

using TlsContext = boost::asio::ssl::context;

/// Reads tls.certificate, tls.key and tls.ca: paths, or `credential:NAME` for what systemd put into
/// $CREDENTIALS_DIRECTORY. Throws ConfigError if only some are set.
void load_tls(ConfigReader& config, TlsSettings& tls);

/// TLS 1.3 and nothing older, with certificates required and checked at both ends; null if `tls` is
/// off. Throws std::runtime_error that names the file and what is wrong with it: not there, not
/// PEM, a key that anybody can read or that is not the certificate's, a certificate out of date.
std::unique_ptr<TlsContext> make_tls_context(const TlsSettings& tls);

}  // namespace orbbuf
