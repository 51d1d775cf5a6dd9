// SPDX-License-Identifier: Apache-2.0
#include "testing/certificates.hpp"

#include <openssl/pem.h>
#include <openssl/x509.h>

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <vector>

#include "testing/process.hpp"
#include "testing/source_folder.hpp"

namespace orbbuf::test {
namespace {

/// The fenced block ```sh NAME of docs/security.md.
std::string block(const std::string& name) {
  std::string text;
  bool is_inside = false;
  for (const std::string& line :
       read_lines(test::kSourceFolder + std::string("/docs/security.md"))) {
    if (line.starts_with("```")) {
      is_inside = line == "```sh " + name;
    } else if (is_inside) {
      text += line + "\n";
    }
  }
  return text;
}

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

File open(const std::filesystem::path& path, const char* mode) {
  return {std::fopen(path.c_str(), mode), &std::fclose};
}

std::string replace_all(std::string text, const std::string& from, const std::string& to) {
  for (auto at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
  return text;
}

}  // namespace

Certificates::Certificates() {
  for (const char* name : {"ca", "server", "robot"}) make(name, "", "");
}

TlsSettings Certificates::of(const std::string& name) const {
  return {folder_ / (name + ".crt"), folder_ / (name + ".key"), folder_ / "ca.crt"};
}

void Certificates::make(const std::string& name, const std::string& from,
                        const std::string& to) const {
  std::string commands = block(name);
  if (!from.empty()) commands = replace_all(commands, from, to);
  const Finished made =
      run({"sh", "-e", "-c", "cd '" + folder_.path().string() + "'\n" + commands});
  if (made.status != 0) throw std::runtime_error("docs/security.md, " + name + ": " + made.output);
}

void Certificates::expire(const std::string& name) const {
  constexpr long kDay = 24 * 60 * 60;
  const std::unique_ptr<X509, void (*)(X509*)> certificate(
      ::PEM_read_X509(open(of(name).certificate, "r").get(), nullptr, nullptr, nullptr),
      &::X509_free);
  const std::unique_ptr<EVP_PKEY, void (*)(EVP_PKEY*)> key(
      ::PEM_read_PrivateKey(open(folder_ / "ca.key", "r").get(), nullptr, nullptr, nullptr),
      &::EVP_PKEY_free);
  if (!::X509_gmtime_adj(::X509_getm_notBefore(certificate.get()), -2 * kDay) ||
      !::X509_gmtime_adj(::X509_getm_notAfter(certificate.get()), -kDay) ||
      ::X509_sign(certificate.get(), key.get(), ::EVP_sha256()) == 0 ||
      ::PEM_write_X509(open(of(name).certificate, "w").get(), certificate.get()) == 0) {
    throw std::runtime_error("cannot make an expired certificate of " + name);
  }
}

std::vector<std::string> Certificates::overrides(const TlsSettings& tls) {
  return {"tls.certificate=" + tls.certificate.string(), "tls.key=" + tls.key.string(),
          "tls.ca=" + tls.ca.string()};
}

}  // namespace orbbuf::test
