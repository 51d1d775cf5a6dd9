// SPDX-License-Identifier: Apache-2.0
// A file system whose disk is slow or fails: shows FOLDER at MOUNT, and each write and each sync
// takes MS milliseconds. From SIGUSR1 to SIGUSR2 they fail with ERROR: full (ENOSPC) or broken
// (EIO).
//   orbbuf-bad-disk FOLDER MOUNT MS ERROR
// Runs until it is killed or MOUNT is unmounted. Wants root.
#define FUSE_USE_VERSION 31
#include <dirent.h>
#include <fcntl.h>
#include <fuse3/fuse.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>

namespace {

std::string folder;                  // of main()
std::chrono::milliseconds delay{0};  // of main()
int error = EIO;                     // of main()
std::atomic<bool> is_failing{false};

std::string real(const char* path) { return folder + path; }
int result(ssize_t value) { return value < 0 ? -errno : static_cast<int>(value); }
int fd_of(const fuse_file_info* info) { return static_cast<int>(info->fh); }

/// What the disk does for a write or a sync; 0 or the negative error.
int disk() {
  std::this_thread::sleep_for(delay);
  return is_failing ? -error : 0;
}

int get_attributes(const char* path, struct stat* status, fuse_file_info* /*info*/) {
  return result(::lstat(real(path).c_str(), status));
}

int read_folder(const char* path, void* buffer, fuse_fill_dir_t fill, off_t /*offset*/,
                fuse_file_info* /*info*/, fuse_readdir_flags /*flags*/) {
  DIR* const open = ::opendir(real(path).c_str());
  if (open == nullptr) return -errno;
  while (const dirent* entry = ::readdir(open)) {
    fill(buffer, entry->d_name, nullptr, 0, fuse_fill_dir_flags{});
  }
  return result(::closedir(open));
}

int open_file(const char* path, fuse_file_info* info) {
  const int fd = ::open(real(path).c_str(), info->flags & ~O_APPEND);
  info->fh = static_cast<std::uint64_t>(fd);
  return fd < 0 ? -errno : 0;
}

int create_file(const char* path, mode_t mode, fuse_file_info* info) {
  if (is_failing) return -error;
  const int fd = ::open(real(path).c_str(), (info->flags & ~O_APPEND) | O_CREAT, mode);
  info->fh = static_cast<std::uint64_t>(fd);
  return fd < 0 ? -errno : 0;
}

int read_file(const char* /*path*/, char* out, std::size_t size, off_t at, fuse_file_info* info) {
  return result(::pread(fd_of(info), out, size, at));
}

int write_file(const char* /*path*/, const char* in, std::size_t size, off_t at,
               fuse_file_info* info) {
  if (const int failed = disk()) return failed;
  return result(::pwrite(fd_of(info), in, size, at));
}

int sync_file(const char* /*path*/, int /*only_data*/, fuse_file_info* info) {
  if (const int failed = disk()) return failed;
  return result(::fsync(fd_of(info)));
}

int sync_folder(const char* path, int only_data, fuse_file_info* /*info*/) {
  fuse_file_info open{};
  open.flags = O_RDONLY | O_DIRECTORY;
  if (const int failed = open_file(path, &open)) return failed;
  const int done = sync_file(path, only_data, &open);
  ::close(fd_of(&open));
  return done;
}

int release_file(const char* /*path*/, fuse_file_info* info) {
  return result(::close(fd_of(info)));
}

int make_folder(const char* path, mode_t mode) {
  return is_failing ? -error : result(::mkdir(real(path).c_str(), mode));
}
int remove_file(const char* path) { return result(::unlink(real(path).c_str())); }
int remove_folder(const char* path) { return result(::rmdir(real(path).c_str())); }
int rename_file(const char* from, const char* to, unsigned flags) {
  return flags != 0 ? -EINVAL : result(::rename(real(from).c_str(), real(to).c_str()));
}
int truncate_file(const char* path, off_t size, fuse_file_info* /*info*/) {
  return result(::truncate(real(path).c_str(), size));
}
int set_times(const char* path, const timespec* times, fuse_file_info* /*info*/) {
  return result(::utimensat(AT_FDCWD, real(path).c_str(), times, AT_SYMLINK_NOFOLLOW));
}
int get_space(const char* path, struct statvfs* space) {
  return result(::statvfs(real(path).c_str(), space));
}

fuse_operations operations() {
  fuse_operations all{};
  all.getattr = get_attributes;
  all.readdir = read_folder;
  all.open = open_file;
  all.create = create_file;
  all.read = read_file;
  all.write = write_file;
  all.fsync = sync_file;
  all.fsyncdir = sync_folder;
  all.release = release_file;
  all.mkdir = make_folder;
  all.unlink = remove_file;
  all.rmdir = remove_folder;
  all.rename = rename_file;
  all.truncate = truncate_file;
  all.utimens = set_times;
  all.statfs = get_space;
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fputs("usage: orbbuf-bad-disk FOLDER MOUNT MS full|broken\n", stderr);
    return 2;
  }
  folder = std::filesystem::absolute(argv[1]).string();
  delay = std::chrono::milliseconds(std::strtol(argv[3], nullptr, 10));
  error = std::string(argv[4]) == "full" ? ENOSPC : EIO;
  std::signal(SIGUSR1, [](int) { is_failing = true; });
  std::signal(SIGUSR2, [](int) { is_failing = false; });
  std::array<char, 3> foreground{"-f"};
  std::array<char*, 3> words{argv[0], foreground.data(), argv[2]};
  const fuse_operations all = operations();
  return fuse_main(static_cast<int>(words.size()), words.data(), &all, nullptr);
}
