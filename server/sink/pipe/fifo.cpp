// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/fifo.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>

#include <cerrno>
#include <system_error>
#include <utility>

namespace orbbuf {

Fifo::Fifo(std::filesystem::path path) : path_(std::move(path)) {}

Result<UniqueFd> Fifo::connect(std::function<void()> /*gone*/) {
  std::error_code ignored;  // mkfifo says what is wrong with the folder
  // Every time: it may have been removed while it had no reader.
  if (path_.has_parent_path()) std::filesystem::create_directories(path_.parent_path(), ignored);
  if (::mkfifo(path_.c_str(), 0666) != 0 && errno != EEXIST) {
    return system_error("make FIFO " + path_.string(), errno);
  }
  struct stat status {};
  if (::stat(path_.c_str(), &status) != 0) return system_error("stat " + path_.string(), errno);
  if (!S_ISFIFO(status.st_mode)) return Error{"open FIFO " + path_.string() + ": not a FIFO"};

  UniqueFd fd(::open(path_.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC));
  if (!fd) {
    if (errno == ENXIO) return UniqueFd();  // no reader
    return system_error("open FIFO " + path_.string(), errno);
  }
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK) return UniqueFd();  // another session writes
    return system_error("lock FIFO " + path_.string(), errno);
  }
  int left_bytes = 0;
  if (::ioctl(fd.get(), FIONREAD, &left_bytes) == 0 && left_bytes > 0) return UniqueFd();
  return fd;
}

}  // namespace orbbuf
