// SPDX-License-Identifier: Apache-2.0
#include "server/sink/read_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>

#include <cerrno>

#include "common/unique_fd.hpp"

namespace orbbuf {

Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& path) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status {};
  if (!fd || ::fstat(fd.get(), &status) != 0) return system_error("read " + path.string(), errno);
  constexpr std::size_t kSpare = 4096;  // and for the read that finds the end
  std::vector<std::uint8_t> content(static_cast<std::size_t>(status.st_size) + kSpare);
  std::size_t bytes = 0;
  while (true) {
    const ssize_t got = ::read(fd.get(), content.data() + bytes, content.size() - bytes);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return system_error("read " + path.string(), errno);
    if (got == 0) break;
    bytes += static_cast<std::size_t>(got);
    if (bytes == content.size()) content.resize(2 * bytes);
  }
  content.erase(content.begin() + static_cast<std::ptrdiff_t>(bytes), content.end());
  return content;
}

}  // namespace orbbuf
