// SPDX-License-Identifier: Apache-2.0
#include "server/retention/remove_folder.hpp"

#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace orbbuf {

namespace fs = std::filesystem;

Result<bool> remove_folder(const fs::path& folder, std::chrono::steady_clock::time_point deadline) {
  std::error_code failed;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    const fs::path& path = entry->path();
    std::error_code ignored;  // then unlink() says why
    if (fs::is_directory(entry->symlink_status(ignored))) {
      auto is_gone = remove_folder(path, deadline);
      if (!is_gone || !is_gone.value()) return is_gone;
    } else if (::unlink(path.c_str()) != 0 && errno != ENOENT) {
      return system_error("remove " + path.string(), errno);
    }
    if (std::chrono::steady_clock::now() >= deadline) return false;
  }
  if (failed && failed != std::errc::no_such_file_or_directory) {
    return system_error("read " + folder.string(), failed.value());
  }
  if (::rmdir(folder.c_str()) != 0 && errno != ENOENT) {
    return system_error("remove " + folder.string(), errno);
  }
  return true;
}

}  // namespace orbbuf
