// SPDX-License-Identifier: Apache-2.0
#include "common/file_io.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <system_error>
#include <utility>

namespace orbbuf {
namespace {

/// `write`: some of the bytes, as write(2) does.
template <class Write>
std::optional<Error> write_by(Write write, std::span<const std::uint8_t> bytes,
                              const std::filesystem::path& path) {
  while (!bytes.empty()) {
    const ssize_t written = write(bytes);
    if (written > 0) {
      bytes = bytes.subspan(static_cast<std::size_t>(written));
    } else if (written == 0 || errno != EINTR) {
      return system_error("write " + path.string(), written < 0 ? errno : ENOSPC);
    }
  }
  return std::nullopt;
}

/// `fd` is null if opening has failed just now.
Result<std::vector<std::uint8_t>> read_all(const UniqueFd& fd, const std::filesystem::path& path) {
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

}  // namespace

Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& path) {
  return read_all(UniqueFd(::open(path.c_str(), O_RDONLY | O_CLOEXEC)), path);
}

Result<UniqueFd> open_regular(const std::filesystem::path& path) {
  UniqueFd fd(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (!fd && errno == ENOENT) return fd;
  struct stat status {};
  if (!fd || ::fstat(fd.get(), &status) != 0) return system_error("open " + path.string(), errno);
  if (S_ISREG(status.st_mode) || S_ISDIR(status.st_mode)) return fd;
  return Error{"open " + path.string() + ": it is a FIFO or a device, not a file"};
}

Result<std::vector<std::uint8_t>> read_regular(const std::filesystem::path& path) {
  auto fd = open_regular(path);
  if (!fd) return std::move(fd).error();
  errno = ENOENT;  // of one that is not there
  return read_all(fd.value(), path);
}

Result<std::string> read_text(const std::filesystem::path& path) {
  std::error_code ignored;  // then reading says why
  if (!std::filesystem::exists(path, ignored) && !ignored) return std::string();
  const auto content = read_file(path);
  if (!content) return content.error();
  return std::string(content.value().begin(), content.value().end());
}

Result<std::size_t> read_at(int fd, std::uint64_t offset, std::span<std::uint8_t> into,
                            const std::filesystem::path& path) {
  std::size_t got = 0;
  while (got < into.size()) {
    const ssize_t more =
        ::pread(fd, into.data() + got, into.size() - got, static_cast<off_t>(offset + got));
    if (more < 0 && errno == EINTR) continue;
    if (more < 0) return system_error("read " + path.string(), errno);
    if (more == 0) break;
    got += static_cast<std::size_t>(more);
  }
  return got;
}

std::optional<Error> write_all(int fd, std::span<const std::uint8_t> bytes,
                               const std::filesystem::path& path) {
  return write_by([fd](auto rest) { return ::write(fd, rest.data(), rest.size()); }, bytes, path);
}

std::optional<Error> write_all_at(int fd, std::uint64_t offset, std::span<const std::uint8_t> bytes,
                                  const std::filesystem::path& path) {
  const auto write = [fd, end = offset + bytes.size()](auto rest) {
    return ::pwrite(fd, rest.data(), rest.size(), static_cast<off_t>(end - rest.size()));
  };
  return write_by(write, bytes, path);
}

std::optional<Error> close_written(UniqueFd fd, const std::filesystem::path& path) {
  // On Linux the descriptor is gone even after EINTR, and what was written is not in doubt.
  if (::close(fd.release()) == 0 || errno == EINTR) return std::nullopt;
  return system_error("close " + path.string(), errno);
}

std::optional<Error> write_new(const std::filesystem::path& path,
                               std::span<const std::uint8_t> bytes, bool is_synced) {
  UniqueFd fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!fd) return system_error("create " + path.string(), errno);
  if (auto error = write_all(fd.get(), bytes, path)) return error;
  if (is_synced && ::fdatasync(fd.get()) != 0) return system_error("sync " + path.string(), errno);
  return close_written(std::move(fd), path);
}

std::optional<Error> move_file(const std::filesystem::path& from, const std::filesystem::path& to) {
  if (std::rename(from.c_str(), to.c_str()) == 0) return std::nullopt;
  return system_error("rename " + from.string() + " to " + to.string(), errno);
}

std::optional<Error> write_file(const std::filesystem::path& path,
                                const std::filesystem::path& temporary,
                                std::span<const std::uint8_t> bytes) {
  auto error = write_new(temporary, bytes, false);
  if (!error) error = move_file(temporary, path);
  if (error) ::unlink(temporary.c_str());
  return error;
}

std::optional<Error> sync(const std::filesystem::path& path) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (fd && ::fsync(fd.get()) == 0) return std::nullopt;
  return system_error("sync " + path.string(), errno);
}

}  // namespace orbbuf
