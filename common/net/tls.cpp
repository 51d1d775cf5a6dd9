// SPDX-License-Identifier: Apache-2.0
#include "common/net/tls.hpp"

#include <fmt/core.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>

#include <boost/asio/ssl/context.hpp>
#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>

#include "common/error.hpp"
#include "common/log.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using boost::system::error_code;

fs::path read_path(ConfigReader& config, std::string_view key) {
  constexpr std::string_view kCredential = "credential:";
  const std::string text = config.text(key, "");
  if (!text.starts_with(kCredential)) return config.path(key, {});
  const std::string name = text.substr(kCredential.size());
  if (name.empty() || name.find('/') != std::string::npos) {
    config.fail(key, "expected credential:NAME, where LoadCredential= of the unit sets NAME");
  }
  const char* const folder = std::getenv("CREDENTIALS_DIRECTORY");  // NOLINT(concurrency-mt-unsafe)
  if (folder == nullptr) {
    config.fail(key,
                "no credentials: $CREDENTIALS_DIRECTORY is not set; add LoadCredential= to the "
                "systemd unit");
  }
  return fs::path(folder) / name;
}

[[noreturn]] void refuse_file(const char* what, const fs::path& file, std::string_view why) {
  throw std::runtime_error(fmt::format("cannot use the TLS {} {}: {}", what, file.string(), why));
}

/// OpenSSL has its own words for a file that is not there; these are the system's.
void require_readable(const char* what, const fs::path& file) {
  if (std::ifstream(file)) return;
  throw_system_error(fmt::format("cannot use the TLS {} {}", what, file.string()));
}

void require_private(const fs::path& key) {
  const auto permissions = fs::status(key).permissions();
  if ((permissions & fs::perms::others_all) != fs::perms::none) {
    refuse_file("key", key, "other users have access to it; run chmod 600 on it");
  }
}

/// Empty: it is in date.
std::string_view fault_of_date(TlsContext& context) {
  const X509* const own = ::SSL_CTX_get0_certificate(context.native_handle());
  if (::X509_cmp_current_time(::X509_get0_notAfter(own)) < 0) return "it has expired";
  const bool is_early = ::X509_cmp_current_time(::X509_get0_notBefore(own)) > 0;
  return is_early ? "it is not valid yet, or this machine's clock is wrong" : "";
}

}  // namespace

void load_tls(ConfigReader& config, TlsSettings& tls) {
  tls.certificate = read_path(config, "tls.certificate");
  tls.key = read_path(config, "tls.key");
  tls.ca = read_path(config, "tls.ca");
  if (!tls.certificate.empty() && tls.key.empty()) {
    config.fail("tls.key", "required with tls.certificate");
  }
  if (!tls.certificate.empty() && tls.ca.empty()) {
    config.fail("tls.ca", "required with tls.certificate: each end checks the other's certificate");
  }
  if (tls.certificate.empty() && !(tls.key.empty() && tls.ca.empty())) {
    config.fail("tls.certificate", "required with tls.key and tls.ca");
  }
}

std::shared_ptr<TlsContext> make_tls_context(const TlsSettings& tls, bool is_robot) {
  if (!tls.is_on()) return nullptr;
  auto context = std::make_shared<TlsContext>(TlsContext::tls);
  ::SSL_CTX_set_min_proto_version(context->native_handle(), TLS1_3_VERSION);
  ::SSL_CTX_set_num_tickets(context->native_handle(), 0);  // every connection is made from nothing
  // The other end has the CA's certificate, or else no use for it.
  SSL_CTX_set_mode(context->native_handle(), SSL_MODE_NO_AUTO_CHAIN);  // NOLINT: OpenSSL's macro
  context->set_verify_mode(boost::asio::ssl::verify_peer |
                           boost::asio::ssl::verify_fail_if_no_peer_cert);
  error_code failed;
  require_readable("certificate", tls.certificate);
  context->use_certificate_chain_file(tls.certificate.string(), failed);
  if (failed) refuse_file("certificate", tls.certificate, failed.message());
  if (const auto fault = fault_of_date(*context); !fault.empty()) {
    if (!is_robot) refuse_file("certificate", tls.certificate, fault);
    log_error("link: the TLS certificate {}: {}; no server will take it", tls.certificate.string(),
              fault);
  }
  require_readable("key", tls.key);
  require_private(tls.key);
  context->use_private_key_file(tls.key.string(), TlsContext::pem, failed);
  if (failed) refuse_file("key", tls.key, failed.message());
  require_readable("CA certificate", tls.ca);
  context->load_verify_file(tls.ca.string(), failed);
  if (failed) refuse_file("CA certificate", tls.ca, failed.message());
  return context;
}

std::shared_ptr<TlsContext> reload_tls_context(const TlsSettings& tls) {
  if (!tls.is_on()) {
    log_info("SIGHUP: no [tls], so there are no certificates to read again");
    return nullptr;
  }
  try {
    auto context = make_tls_context(tls);
    log_info("SIGHUP: read the certificates again; new connections use them");
    return context;
  } catch (const std::runtime_error& error) {
    log_error("SIGHUP: {}; the certificates read before stay in use", error.what());
    return nullptr;
  }
}

}  // namespace orbbuf
