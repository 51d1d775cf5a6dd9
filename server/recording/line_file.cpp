// SPDX-License-Identifier: Apache-2.0
#include "server/recording/line_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/unique_fd.hpp"
#include "server/recording/file_io.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kLastLineBytes = 255;
constexpr std::size_t kBlockBytes = 65536;

/// Counts lines in a file that comes in blocks, of which a line may span any number.
struct Scan {
  LineFile::Content content;
  off_t complete_bytes = 0;
  off_t bytes = 0;
  std::string line;  // the one not ended yet
  bool has_hole = false;

  /// A power cut may leave zeros where lines were: nothing from there on counts.
  void add(std::string_view block) {
    const std::size_t hole = block.find('\0');
    if (!has_hole) add_text(block.substr(0, hole));
    has_hole = has_hole || hole != block.npos;
    if (has_hole) bytes = complete_bytes + 1;
  }

  void add_text(std::string_view block) {
    while (!block.empty()) {
      const std::size_t end = block.find('\n');
      const auto part = block.substr(0, end);
      line.append(part.substr(0, kLastLineBytes - std::min(kLastLineBytes, line.size())));
      bytes += static_cast<off_t>(part.size());
      if (end == std::string_view::npos) return;
      complete_bytes = ++bytes;
      ++content.lines;
      content.last = std::exchange(line, {});
      block.remove_prefix(end + 1);
    }
  }
};

}  // namespace

LineFile::LineFile(std::filesystem::path path, std::string first_line)
    : path_(std::move(path)), first_line_(std::move(first_line)) {}

Result<LineFile::Content> LineFile::recover() {
  const UniqueFd fd(::open(path_.c_str(), O_RDWR | O_CLOEXEC));
  if (!fd) {
    if (errno == ENOENT) return Content{};
    return system_error("open " + path_.string(), errno);
  }
  Scan scan;
  std::array<char, kBlockBytes> block;
  while (true) {
    const ssize_t got = ::read(fd.get(), block.data(), block.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return system_error("read " + path_.string(), errno);
    if (got == 0) break;
    scan.add({block.data(), static_cast<std::size_t>(got)});
  }
  if (scan.complete_bytes < scan.bytes) {
    if (auto error = cut(fd.get(), scan.complete_bytes)) return *error;
  }
  return std::move(scan.content);
}

std::optional<Error> LineFile::append(std::string_view lines) {
  UniqueFd fd(::open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0644));
  if (!fd) return system_error("open " + path_.string(), errno);
  if (cut_due_) {
    if (auto error = cut(fd.get(), *cut_due_)) return error;
  }
  struct stat status {};
  if (::fstat(fd.get(), &status) != 0) return system_error("stat " + path_.string(), errno);
  std::string text;
  if (status.st_size == 0 && !first_line_.empty()) text = first_line_ + '\n';
  text += lines;
  if (auto error = write_all(fd.get(), as_bytes(text), path_)) {
    cut(fd.get(), status.st_size);
    return error;
  }
  return close_written(std::move(fd), path_);
}

std::optional<Error> LineFile::cut(int fd, off_t bytes) {
  cut_due_ = bytes;
  struct stat status {};
  if (::fstat(fd, &status) != 0) return system_error("stat " + path_.string(), errno);
  // A file that became shorter meanwhile was replaced by another program: nothing of ours is in it.
  if (status.st_size > bytes && ::ftruncate(fd, bytes) != 0) {
    return system_error("truncate " + path_.string(), errno);
  }
  cut_due_.reset();
  return std::nullopt;
}

}  // namespace orbbuf
