// SPDX-License-Identifier: Apache-2.0
#include "server/http/response.hpp"

#include <fcntl.h>
#include <fmt/core.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <boost/beast/http/status.hpp>
#include <utility>

namespace orbbuf {
namespace {

std::string reason_for(unsigned status) {
  return std::string(
      boost::beast::http::obsolete_reason(boost::beast::http::int_to_status(status)));
}

}  // namespace

std::shared_ptr<ServedFile> ServedFile::open(const std::filesystem::path& path) {
  UniqueFd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  struct stat status {};
  if (file.get() < 0 || ::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode)) {
    return nullptr;
  }
  return std::shared_ptr<ServedFile>(
      new ServedFile(std::move(file), static_cast<std::uint64_t>(status.st_size)));
}

std::vector<std::uint8_t> ServedFile::read() {
  std::vector<std::uint8_t> piece(
      static_cast<std::size_t>(std::min<std::uint64_t>(kPieceBytes, size_ - position_)));
  const ssize_t count = piece.empty() ? 0
                                      : ::pread(file_.get(), piece.data(), piece.size(),
                                                static_cast<off_t>(position_));
  piece.resize(count > 0 ? static_cast<std::size_t>(count) : 0);
  position_ += piece.size();
  return piece;
}

std::uint64_t HttpResponse::body_bytes() const {
  if (text) return text->size();
  if (image) return image->left().size();
  return file ? file->size() : 0;
}

HttpResponse text_response(std::string body, std::string_view type) {
  HttpResponse response;
  response.type = type;
  response.text = std::make_shared<const std::string>(std::move(body));
  return response;
}

HttpResponse error_response(unsigned status, std::string_view what) {
  auto response = text_response(fmt::format("{}\n", what.empty() ? reason_for(status) : what));
  response.status = status;
  return response;
}

std::string head_of(const HttpResponse& response, bool keeps_alive) {
  return fmt::format(
      "HTTP/1.1 {} {}\r\n"
      "Content-Type: {}\r\n"
      "Content-Length: {}\r\n"
      "Connection: {}\r\n"
      "Cache-Control: no-store\r\n"
      "Content-Security-Policy: {}\r\n"
      "Cross-Origin-Resource-Policy: same-origin\r\n"
      "Referrer-Policy: no-referrer\r\n"
      "X-Content-Type-Options: nosniff\r\n"
      "{}\r\n",
      response.status, reason_for(response.status), response.type, response.body_bytes(),
      keeps_alive ? "keep-alive" : "close", response.policy,
      response.status == 405 ? "Allow: GET, HEAD\r\n" : "");
}

}  // namespace orbbuf
