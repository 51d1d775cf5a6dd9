// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/lock_folder.hpp"

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>
#include <stdexcept>
#include <system_error>

#include "common/error.hpp"
#include "common/log.hpp"

namespace orbbuf {

UniqueFd lock_folder(const std::filesystem::path& folder) {
  UniqueFd fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!fd) throw_system_error("cannot open files.path " + folder.string());
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) == 0) return fd;
  if (errno == EWOULDBLOCK) {
    throw std::runtime_error("cannot use files.path " + folder.string() +
                             ": another orbbuf-server uses it; set another files.path or stop it");
  }
  log_warn("cannot lock {}: {}; make sure that no second server uses it", folder.string(),
           std::generic_category().message(errno));
  return fd;
}

}  // namespace orbbuf
