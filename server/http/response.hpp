// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/frame.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {

/// A file of a session, read from its beginning a piece at a time, so that the thread that also
/// writes frames is never kept from that for long. Blocking; reentrant.
class ServedFile {
 public:
  static constexpr std::size_t kPieceBytes = 64UL * 1024;

  /// Null if `path` is not a file that can be read; a link is none.
  static std::shared_ptr<ServedFile> open(const std::filesystem::path& path);

  /// When it was opened: what comes later is not read.
  std::uint64_t size() const { return size_; }
  /// The next piece; empty at the end, and early if the file has become shorter or is broken.
  std::vector<std::uint8_t> read();

 private:
  ServedFile(UniqueFd file, std::uint64_t size) : file_(std::move(file)), size_(size) {}

  UniqueFd file_;
  const std::uint64_t size_;
  std::uint64_t position_ = 0;
};

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
