// SPDX-License-Identifier: Apache-2.0
// Files, and what is read and written by descriptor.
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <sys/stat.h>
#include <sys/statfs.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "testing/simulation/disk.hpp"
#include "testing/simulation/facts.hpp"
#include "testing/simulation/interpose.hpp"
#include "testing/simulation/real.hpp"
#include "testing/simulation/world.hpp"

namespace orbbuf::simulation {
namespace {

struct OpenFile {
  std::uint64_t inode = 0;
  std::string name;  ///< below the machine's folder
  bool is_appending = false;
};

std::map<int, OpenFile>& open_files() {
  static auto* const all = new std::map<int, OpenFile>();
  return *all;
}

OpenFile* find(int fd) {
  if (!is_in_machine()) return nullptr;
  const auto found = open_files().find(fd);
  return found == open_files().end() ? nullptr : &found->second;
}

/// Below the machine's folder; nothing: it is elsewhere.
std::optional<std::string> name_of(int folder, const char* path) {
  if (!is_in_machine() || path == nullptr) return std::nullopt;
  static const std::string root = world_folder + "/" + folder_name(my_machine_number());
  std::string whole = path;
  if (whole.empty() || whole[0] != '/') {
    const OpenFile* const base = folder == AT_FDCWD ? nullptr : find(folder);
    if (folder != AT_FDCWD && base == nullptr) return std::nullopt;
    whole = (base == nullptr ? world_folder : root + "/" + base->name) + "/" + whole;
  }
  if (whole.find("/.") != std::string::npos || whole.find("//") != std::string::npos) {
    whole = std::filesystem::path(whole).lexically_normal().string();
  }
  while (whole.ends_with('/')) whole.pop_back();
  if (!whole.starts_with(root)) return std::nullopt;
  if (whole.size() == root.size()) return std::string();
  if (whole[root.size()] != '/') return std::nullopt;
  return whole.substr(root.size() + 1);
}

int failed(int error) {
  errno = error;
  return -1;
}

Disk& disk() { return my_machine().disk; }

bool is_failing() { return world->now < disk().fails_until; }

std::uint64_t size_of(int fd) {
  struct stat status {};
  return ::fstat(fd, &status) == 0 ? static_cast<std::uint64_t>(status.st_size) : 0;
}

/// What goes when the name goes.
std::uint64_t freed_by(int folder, const char* path) {
  struct stat status {};
  if (::fstatat(folder, path, &status, AT_SYMLINK_NOFOLLOW) != 0) return 0;
  return S_ISREG(status.st_mode) && status.st_nlink == 1
             ? static_cast<std::uint64_t>(status.st_size)
             : 0;
}

int open_file(int folder, const char* path, int flags, unsigned mode) {
  const auto name = name_of(folder, path);
  if (!name)
    return static_cast<int>(
        raw_call(SYS_openat, folder, reinterpret_cast<long>(path), flags, mode));
  const bool may_write = (flags & O_ACCMODE) != O_RDONLY;
  if (may_write) interruption_point();
  if (may_write && is_failing()) return failed(EIO);
  struct stat before {};
  const bool may_change = (flags & (O_CREAT | O_TRUNC)) != 0;
  const bool was_there = !may_change || ::fstatat(folder, path, &before, 0) == 0;
  const int fd =
      static_cast<int>(raw_call(SYS_openat, folder, reinterpret_cast<long>(path), flags, mode));
  if (fd < 0) return fd;
  struct stat status {};
  ::fstat(fd, &status);
  open_files()[fd] = {status.st_ino, *name, (flags & O_APPEND) != 0};
  if (!was_there) log_operation(DiskOperation::kCreate, status.st_ino, 0, *name);
  if (was_there && (flags & O_TRUNC) != 0 && before.st_size > 0) {
    disk().used -= static_cast<std::uint64_t>(before.st_size);
    log_operation(DiskOperation::kTruncate, status.st_ino, 0);
  }
  return fd;
}

/// `offset`: -1: where the descriptor is.
ssize_t write_file(int fd, const void* bytes, std::size_t count, off_t offset) {
  const std::uint64_t inode = find(fd)->inode;
  const bool is_appending = find(fd)->is_appending;
  interruption_point();
  if (world->now < disk().slow_until) {
    block(Wait::kSleep, nullptr,
          world->now + world->random.between(kMillisecond, 20 * kMillisecond));
  }
  if (is_failing()) return failed(EIO);
  const std::uint64_t size = size_of(fd);
  std::uint64_t at = static_cast<std::uint64_t>(offset);
  if (offset < 0) at = is_appending ? size : static_cast<std::uint64_t>(::lseek(fd, 0, SEEK_CUR));
  const std::uint64_t growth = at + count > size ? at + count - size : 0;
  const std::uint64_t room = disk().capacity > disk().used ? disk().capacity - disk().used : 0;
  if (growth > room) {
    if (growth - room >= count) return failed(ENOSPC);
    count -= growth - room;
  }
  const ssize_t written =
      offset < 0 ? raw_call(SYS_write, fd, reinterpret_cast<long>(bytes), static_cast<long>(count))
                 : raw_call(SYS_pwrite64, fd, reinterpret_cast<long>(bytes),
                            static_cast<long>(count), offset);
  if (written <= 0) return written;
  const std::uint64_t end = at + static_cast<std::uint64_t>(written);
  if (end > size) disk().used += end - size;
  log_operation(DiskOperation::kWrite, inode, at, {}, {},
                {static_cast<const char*>(bytes), static_cast<std::size_t>(written)});
  return written;
}

int sync_file(int fd, bool is_all) {
  const OpenFile file = *find(fd);
  interruption_point();
  const std::uint64_t before = disk().operations + 1;
  Time takes = disk().sync_time + world->random.between(0, disk().sync_time);
  if (world->now < disk().slow_until)
    takes += world->random.between(100 * kMillisecond, 3 * kSecond);
  takes = std::max(takes, disk().syncs_hang_until - world->now);
  if (takes > 0) block(Wait::kSleep, nullptr, world->now + takes);
  const std::uint64_t inode = is_all ? 0 : file.inode;
  if (is_failing()) {
    log_operation(DiskOperation::kSyncFailed, inode, before);
    return failed(EIO);
  }
  log_operation(DiskOperation::kSync, inode, before);
  interruption_point();
  return 0;
}

int remove_name(int folder, const char* path, int flags) {
  const auto name = name_of(folder, path);
  if (!name)
    return static_cast<int>(raw_call(SYS_unlinkat, folder, reinterpret_cast<long>(path), flags));
  interruption_point();
  if (is_failing()) return failed(EIO);
  const std::uint64_t freed = freed_by(folder, path);
  const int result =
      static_cast<int>(raw_call(SYS_unlinkat, folder, reinterpret_cast<long>(path), flags));
  if (result != 0) return result;
  disk().used -= std::min(disk().used, freed);
  log_operation(DiskOperation::kRemove, 0, 0, *name);
  return 0;
}

int set_size(int fd, std::uint64_t inode, const char* path, off_t size) {
  interruption_point();
  if (is_failing()) return failed(EIO);
  struct stat before {};
  if ((fd >= 0 ? ::fstat(fd, &before) : ::stat(path, &before)) != 0) return -1;
  const long result = fd >= 0 ? raw_call(SYS_ftruncate, fd, size)
                              : raw_call(SYS_truncate, reinterpret_cast<long>(path), size);
  if (result != 0) return -1;
  disk().used =
      disk().used + static_cast<std::uint64_t>(size) - static_cast<std::uint64_t>(before.st_size);
  log_operation(DiskOperation::kTruncate, inode == 0 ? before.st_ino : inode,
                static_cast<std::uint64_t>(size));
  return 0;
}

ssize_t write_log(const char* text, std::size_t count) {
  note_log(my_machine_number(), {text, count});
  return static_cast<ssize_t>(count);
}

}  // namespace
}  // namespace orbbuf::simulation

using namespace orbbuf::simulation;  // NOLINT: what follows are the C library's names

#define ORBBUF_OPEN(name)                                                           \
  extern "C" int simulated_##name(const char* path, int flags, ...) __asm__(#name); \
  extern "C" int simulated_##name(const char* path, int flags, ...) {               \
    va_list list;                                                                   \
    va_start(list, flags);                                                          \
    const unsigned mode = va_arg(list, unsigned);                                   \
    va_end(list);                                                                   \
    return open_file(AT_FDCWD, path, flags, mode);                                  \
  }
#define ORBBUF_OPENAT(name)                                                                     \
  extern "C" int simulated_##name(int folder, const char* path, int flags, ...) __asm__(#name); \
  extern "C" int simulated_##name(int folder, const char* path, int flags, ...) {               \
    va_list list;                                                                               \
    va_start(list, flags);                                                                      \
    const unsigned mode = va_arg(list, unsigned);                                               \
    va_end(list);                                                                               \
    return open_file(folder, path, flags, mode);                                                \
  }
ORBBUF_OPEN(open)
ORBBUF_OPEN(open64)
ORBBUF_OPENAT(openat)
ORBBUF_OPENAT(openat64)

// With which libstdc++ opens what it reads; the robots' images among that.
ORBBUF_INTERPOSE(FILE*, fopen64, const char* path, const char* mode) {
  ORBBUF_REAL(FILE * (*)(const char*, const char*), "fopen64");
  if (is_in_machine()) note_open(my_machine_number(), path);
  return real_function(path, mode);
}
ORBBUF_INTERPOSE(int, close, int fd) {
  if (is_in_machine()) {
    forget_descriptor(fd);
    open_files().erase(fd);
  }
  return static_cast<int>(raw_call(SYS_close, fd));
}
ORBBUF_INTERPOSE(int, closedir, DIR* folder) {
  ORBBUF_REAL(int (*)(DIR*), "closedir");
  if (is_in_machine()) open_files().erase(::dirfd(folder));
  return real_function(folder);
}
ORBBUF_INTERPOSE(ssize_t, read, int fd, void* into, size_t room) {
  if (is_simulated(fd)) {
    const iovec part{into, room};
    return simulated_input(fd, &part, 1, 0);
  }
  return raw_call(SYS_read, fd, reinterpret_cast<long>(into), static_cast<long>(room));
}
ORBBUF_INTERPOSE(ssize_t, readv, int fd, const iovec* parts, int count) {
  if (is_simulated(fd)) return simulated_input(fd, parts, static_cast<std::size_t>(count), 0);
  return raw_call(SYS_readv, fd, reinterpret_cast<long>(parts), count);
}
ORBBUF_INTERPOSE(ssize_t, write, int fd, const void* bytes, size_t count) {
  if (is_simulated(fd)) {
    const iovec part{const_cast<void*>(bytes), count};
    return simulated_output(fd, &part, 1, 0);
  }
  if (is_in_machine() && fd == STDERR_FILENO)
    return write_log(static_cast<const char*>(bytes), count);
  if (find(fd) != nullptr) return write_file(fd, bytes, count, -1);
  return raw_call(SYS_write, fd, reinterpret_cast<long>(bytes), static_cast<long>(count));
}
ORBBUF_INTERPOSE(ssize_t, writev, int fd, const iovec* parts, int count) {
  if (is_simulated(fd)) return simulated_output(fd, parts, static_cast<std::size_t>(count), 0);
  if (find(fd) == nullptr) return raw_call(SYS_writev, fd, reinterpret_cast<long>(parts), count);
  ssize_t total = 0;
  for (int i = 0; i < count; ++i) {
    const ssize_t written = write_file(fd, parts[i].iov_base, parts[i].iov_len, -1);
    if (written < 0) return total > 0 ? total : written;
    total += written;
    if (static_cast<std::size_t>(written) < parts[i].iov_len) break;
  }
  return total;
}
ORBBUF_INTERPOSE(ssize_t, pwrite64, int fd, const void* bytes, size_t count, off_t offset) {
  if (find(fd) != nullptr) return write_file(fd, bytes, count, offset);
  return raw_call(SYS_pwrite64, fd, reinterpret_cast<long>(bytes), static_cast<long>(count),
                  offset);
}
ORBBUF_INTERPOSE(ssize_t, pwrite, int fd, const void* bytes, size_t count, off_t offset) {
  return simulated_pwrite64(fd, bytes, count, offset);
}
ORBBUF_INTERPOSE(int, ftruncate64, int fd, off_t size) {
  if (const auto* const file = find(fd)) return set_size(fd, file->inode, nullptr, size);
  return static_cast<int>(raw_call(SYS_ftruncate, fd, size));
}
ORBBUF_INTERPOSE(int, ftruncate, int fd, off_t size) { return simulated_ftruncate64(fd, size); }
ORBBUF_INTERPOSE(int, truncate, const char* path, off_t size) {
  if (name_of(AT_FDCWD, path)) return set_size(-1, 0, path, size);
  return static_cast<int>(raw_call(SYS_truncate, reinterpret_cast<long>(path), size));
}
ORBBUF_INTERPOSE(int, truncate64, const char* path, off_t size) {
  return simulated_truncate(path, size);
}
ORBBUF_INTERPOSE(int, fsync, int fd) {
  return find(fd) != nullptr ? sync_file(fd, false) : static_cast<int>(raw_call(SYS_fsync, fd));
}
ORBBUF_INTERPOSE(int, fdatasync, int fd) {
  return find(fd) != nullptr ? sync_file(fd, false) : static_cast<int>(raw_call(SYS_fdatasync, fd));
}
ORBBUF_INTERPOSE(int, syncfs, int fd) {
  return find(fd) != nullptr ? sync_file(fd, true) : static_cast<int>(raw_call(SYS_syncfs, fd));
}
ORBBUF_INTERPOSE(int, unlink, const char* path) { return remove_name(AT_FDCWD, path, 0); }
ORBBUF_INTERPOSE(int, rmdir, const char* path) { return remove_name(AT_FDCWD, path, AT_REMOVEDIR); }
ORBBUF_INTERPOSE(int, unlinkat, int folder, const char* path, int flags) {
  return remove_name(folder, path, flags);
}
ORBBUF_INTERPOSE(int, remove, const char* path) {
  const int failed_as_file = remove_name(AT_FDCWD, path, 0);
  if (failed_as_file == 0 || (errno != EISDIR && errno != EPERM)) return failed_as_file;
  return remove_name(AT_FDCWD, path, AT_REMOVEDIR);
}
ORBBUF_INTERPOSE(int, rename, const char* from, const char* to) {
  const auto name = name_of(AT_FDCWD, from);
  const auto other = name_of(AT_FDCWD, to);
  if (name && other) {
    interruption_point();
    if (is_failing()) return failed(EIO);
    disk().used -= std::min(disk().used, freed_by(AT_FDCWD, to));
  }
  const int result = static_cast<int>(raw_call(
      SYS_renameat2, AT_FDCWD, reinterpret_cast<long>(from), AT_FDCWD, reinterpret_cast<long>(to)));
  if (result == 0 && name && other) log_operation(DiskOperation::kRename, 0, 0, *name, *other);
  return result;
}
ORBBUF_INTERPOSE(int, link, const char* from, const char* to) {
  const auto name = name_of(AT_FDCWD, from);
  const auto other = name_of(AT_FDCWD, to);
  if (name && other) interruption_point();
  const int result = static_cast<int>(raw_call(SYS_linkat, AT_FDCWD, reinterpret_cast<long>(from),
                                               AT_FDCWD, reinterpret_cast<long>(to), 0));
  if (result == 0 && name && other) log_operation(DiskOperation::kLink, 0, 0, *name, *other);
  return result;
}
ORBBUF_INTERPOSE(int, mkdir, const char* path, mode_t mode) {
  const auto name = name_of(AT_FDCWD, path);
  if (name) interruption_point();
  const int result =
      static_cast<int>(raw_call(SYS_mkdirat, AT_FDCWD, reinterpret_cast<long>(path), mode));
  if (result == 0 && name) log_operation(DiskOperation::kMakeFolder, 0, 0, *name);
  return result;
}
ORBBUF_INTERPOSE(int, statvfs, const char* path, struct statvfs* status) {
  ORBBUF_REAL(int (*)(const char*, struct statvfs*), "statvfs");
  const int result = real_function(path, status);
  if (result != 0 || !is_in_machine()) return result;
  constexpr std::uint64_t kBlock = 4096;
  status->f_bsize = status->f_frsize = kBlock;
  status->f_blocks = disk().capacity / kBlock;
  status->f_bfree = status->f_bavail =
      disk().capacity > disk().used ? (disk().capacity - disk().used) / kBlock : 0;
  return 0;
}
ORBBUF_INTERPOSE(int, statfs64, const char* path, struct statfs64* status) {
  ORBBUF_REAL(int (*)(const char*, struct statfs64*), "statfs64");
  const int result = real_function(path, status);
  constexpr long kExt4 = 0xEF53;
  if (result == 0 && is_in_machine()) status->f_type = kExt4;
  return result;
}
