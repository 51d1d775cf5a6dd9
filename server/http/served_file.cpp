// SPDX-License-Identifier: Apache-2.0
#include "server/http/served_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

namespace orbbuf {

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

}  // namespace orbbuf
