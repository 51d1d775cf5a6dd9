// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/frame.hpp"
#include "server/http/served_file.hpp"

namespace orbbuf {

/// Statuses of HTTP.
inline constexpr unsigned kNotFound = 404;
inline constexpr unsigned kUnavailable = 503;

/// What a request is answered with: the body is one of three.
struct HttpResponse {
  unsigned status = 200;
  std::string_view type = "text/plain; charset=utf-8";
  std::string policy = "default-src 'none'; frame-ancestors 'none'";  ///< of contents, for browsers
  std::shared_ptr<const std::string> text;
  FramePtr image;                    ///< its left image
  std::shared_ptr<ServedFile> file;  ///< all that it had when it was opened

  std::uint64_t body_bytes() const;
};

/// `body`, as text of any kind.
HttpResponse text_response(std::string body, std::string_view type = "text/plain; charset=utf-8");
/// One line that says what is wrong.
HttpResponse error_response(unsigned status, std::string_view what = {});

/// The status line and all fields, with the empty line behind them.
std::string head_of(const HttpResponse& response, bool keeps_alive);

}  // namespace orbbuf
