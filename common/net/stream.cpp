// SPDX-License-Identifier: Apache-2.0
#include "common/net/stream.hpp"

#include <fmt/core.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <boost/asio/error.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ssl/error.hpp>
#include <boost/asio/ssl/stream.hpp>

#include "common/log.hpp"

namespace orbbuf {
namespace {

using boost::system::error_code;

/// The only common name of `certificate`; empty if there is not exactly one, or it is no text.
std::string common_name(const X509* certificate) {
  const X509_NAME* const subject = ::X509_get_subject_name(certificate);
  const int index = ::X509_NAME_get_index_by_NID(subject, NID_commonName, -1);
  if (index < 0 || ::X509_NAME_get_index_by_NID(subject, NID_commonName, index) >= 0) return "";
  unsigned char* text = nullptr;
  const int length = ::ASN1_STRING_to_UTF8(
      &text, ::X509_NAME_ENTRY_get_data(::X509_NAME_get_entry(subject, index)));
  if (length < 0) return "";
  std::string name(text, text + length);
  ::OPENSSL_free(text);
  return name;
}

}  // namespace

struct Stream::Tls {
  boost::asio::ssl::stream<Tcp::socket&> stream;
};

Stream::Stream(Tcp::socket socket, TlsContext* tls) : socket_(std::move(socket)) {
  if (tls == nullptr) return;
  tls_ = std::make_unique<Tls>(Tls{{socket_, *tls}});
  tls_->stream.set_verify_callback([this](bool is_fine, boost::asio::ssl::verify_context& context) {
    if (!is_host_expected_) {
      refused_ = "the name in a certificate cannot be compared with link.server";
      return false;
    }
    if (is_fine) return true;
    auto* const store = context.native_handle();
    const X509* const certificate = ::X509_STORE_CTX_get_current_cert(store);
    refused_ = fmt::format("the certificate of \"{}\" was rejected: {}",
                           certificate == nullptr ? "" : printable(common_name(certificate)),
                           ::X509_verify_cert_error_string(::X509_STORE_CTX_get_error(store)));
    return false;
  });
}

Stream::~Stream() = default;

void Stream::async_handshake_as_robot(const std::string& host, Handshaken handler) {
  expect_host(host);
  tls_->stream.async_handshake(boost::asio::ssl::stream_base::client, std::move(handler));
}

void Stream::async_handshake_as_server(Handshaken handler) {
  tls_->stream.async_handshake(boost::asio::ssl::stream_base::server, std::move(handler));
}

void Stream::read_some(const Buffers<boost::asio::mutable_buffer>& buffers, Done done) {
  if (tls_ && !is_bare_) {
    tls_->stream.async_read_some(buffers, std::move(done));
  } else {
    socket_.async_read_some(buffers, std::move(done));
  }
}

void Stream::write_some(const Buffers<boost::asio::const_buffer>& buffers, Done done) {
  if (tls_ && !is_bare_) {
    tls_->stream.async_write_some(buffers, std::move(done));
  } else {
    socket_.async_write_some(buffers, std::move(done));
  }
}

void Stream::expect_host(const std::string& host) {
  X509_VERIFY_PARAM* const expected = ::SSL_get0_param(tls_->stream.native_handle());
  ::X509_VERIFY_PARAM_set_hostflags(expected, X509_CHECK_FLAG_NEVER_CHECK_SUBJECT);
  error_code is_name;
  boost::asio::ip::make_address(host, is_name);
  if (!is_name) {
    // The scope of a link-local address is this machine's matter: no certificate has it.
    const std::string address = host.substr(0, host.find('%'));
    is_host_expected_ = ::X509_VERIFY_PARAM_set1_ip_asc(expected, address.c_str()) == 1;
  } else {
    // No name would be every name.
    is_host_expected_ =
        !host.empty() && ::X509_VERIFY_PARAM_set1_host(expected, host.c_str(), host.size()) == 1;
    // A server behind one address may have several names.
    SSL_set_tlsext_host_name(tls_->stream.native_handle(),
                             host.c_str());  // NOLINT: OpenSSL's macro
  }
}

std::string Stream::peer_name() {
  if (!tls_) return "";
  const std::unique_ptr<X509, decltype(&::X509_free)> certificate(
      ::SSL_get1_peer_certificate(tls_->stream.native_handle()), &::X509_free);
  return certificate ? common_name(certificate.get()) : "";
}

bool Stream::is_peer_plain(const error_code& failed) {
  if (failed.category() != boost::asio::error::get_ssl_category()) return false;
  const int reason = ERR_GET_REASON(static_cast<unsigned long>(failed.value()));
  return reason == SSL_R_WRONG_VERSION_NUMBER || reason == SSL_R_HTTP_REQUEST;
}

std::string Stream::explain(const error_code& failed) const {
  if (!refused_.empty()) return refused_;
  if (failed == boost::asio::error::eof || failed == boost::asio::ssl::error::stream_truncated) {
    return "the peer closed the connection";
  }
  if (failed.category() != boost::asio::error::get_ssl_category()) return failed.message();
  if (is_peer_plain(failed)) return failed.message() + ": the peer does not use TLS";
  // Numbers of alerts that come from the other end: RFC 8446, Sec. 6.
  const int reason = ERR_GET_REASON(static_cast<unsigned long>(failed.value()));
  if (reason >= SSL_AD_REASON_OFFSET) {
    return "the peer rejected the handshake: " + failed.message();
  }
  switch (reason) {
    case SSL_R_UNSUPPORTED_PROTOCOL:
      return failed.message() + ": the peer does not support TLS 1.3";
    case SSL_R_PEER_DID_NOT_RETURN_A_CERTIFICATE:
      return "the peer sent no certificate";
    default:
      return failed.message();
  }
}

}  // namespace orbbuf
