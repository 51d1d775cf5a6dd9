// SPDX-License-Identifier: Apache-2.0
#include "server/http/page.hpp"

#include <openssl/evp.h>
#include <spdlog/fmt/fmt.h>

#include <array>
#include <string>
#include <string_view>

#include "server/http/page_parts.hpp"  // made of page/ by CMake

namespace orbbuf {
namespace {

/// `'sha256-...'`, as a policy of contents names what may be run.
std::string hash_of(std::string_view text) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  ::EVP_Digest(text.data(), text.size(), digest.data(), &size, ::EVP_sha256(), nullptr);
  std::array<unsigned char, std::size_t{2} * EVP_MAX_MD_SIZE> base64{};
  ::EVP_EncodeBlock(base64.data(), digest.data(), static_cast<int>(size));
  return fmt::format("'sha256-{}'", reinterpret_cast<const char*>(base64.data()));
}

std::string with(std::string text, std::string_view placeholder, std::string_view part) {
  return text.replace(text.find(placeholder), placeholder.size(), part);
}

HttpResponse make_page() {
  auto response =
      text_response(with(with(kPageHtml, "/* page.css */", kPageCss), "/* page.js */", kPageJs),
                    "text/html; charset=utf-8");
  response.policy = fmt::format(
      "default-src 'none'; script-src {}; style-src {}; img-src 'self' data:; connect-src 'self'; "
      "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
      hash_of(kPageJs), hash_of(kPageCss));
  return response;
}

}  // namespace

HttpResponse page() {
  static const HttpResponse once = make_page();
  return once;
}

}  // namespace orbbuf
