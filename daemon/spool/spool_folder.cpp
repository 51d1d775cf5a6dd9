// SPDX-License-Identifier: Apache-2.0
#include "daemon/spool/spool_folder.hpp"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "common/byte_order.hpp"
#include "common/decimal.hpp"
#include "common/wire.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSegmentExtension = ".segment";
constexpr std::string_view kCursorExtension = ".cursor";
constexpr std::uint32_t kCursorMagic = 0x4F425343;  // "OBSC"
constexpr std::uint16_t kCursorVersion = 1;
constexpr std::size_t kCursorBytes = 26;
constexpr mode_t kMode = 0600;

[[noreturn]] void fail(const std::string& attempt, int error_number) {
  throw std::runtime_error(system_error(attempt, error_number).text +
                           "; change spool.path, or make it writable for the user of orbbufd");
}

UniqueFd open_or_make(const fs::path& file) {
  return UniqueFd(::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kMode));
}

std::vector<std::uint8_t> to_bytes(const SpoolCursor& cursor) {
  wire::Writer writer(0);
  writer.put(kCursorMagic);
  writer.put(kCursorVersion);
  writer.put(cursor.number);
  writer.put(cursor.offset);
  writer.put(wire::crc32(writer.bytes()));
  return std::move(writer.bytes());
}

}  // namespace

SpoolFolder::SpoolFolder(fs::path path, const std::string& robot_id)
    : path_(std::move(path)), cursor_path_(path_ / (robot_id + std::string(kCursorExtension))) {
  std::error_code failed;
  fs::create_directories(path_, failed);
  if (failed) fail("cannot make the spool " + path_.string(), failed.value());
  const std::string attempt = "cannot write to the spool " + path_.string();
  folder_ = UniqueFd(::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!folder_) fail(attempt, errno);
  lock_ = open_or_make(path_ / "lock");
  if (!lock_ || ::faccessat(folder_.get(), ".", W_OK | X_OK, AT_EACCESS) != 0) fail(attempt, errno);
  if (::flock(lock_.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) fail(attempt, errno);
    throw std::runtime_error("cannot use the spool " + path_.string() +
                             ": another orbbufd uses it; give each one a spool.path of its own");
  }
  cursor_ = open_or_make(cursor_path_);
  if (!cursor_) fail("cannot write " + cursor_path_.string(), errno);
}

fs::path SpoolFolder::segment(std::uint64_t number) const {
  return path_ / fmt::format("{:012}{}", number, kSegmentExtension);
}

std::vector<std::uint64_t> SpoolFolder::segments() const {
  std::vector<std::uint64_t> numbers;
  std::error_code failed;
  for (auto entry = fs::directory_iterator(path_, failed);
       !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    const auto number = parse_digits(entry->path().stem().string());
    if (number && entry->path() == segment(*number)) numbers.push_back(*number);
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

bool SpoolFolder::remove(std::uint64_t number) const {
  const fs::path file = segment(number);
  std::error_code failed;
  fs::remove(file, failed);
  if (failed)
    spdlog::warn("spool: {}", system_error("cannot remove " + file.string(), failed.value()).text);
  return !failed;
}

std::optional<SpoolCursor> SpoolFolder::read_cursor() const {
  std::array<std::uint8_t, kCursorBytes> bytes{};
  if (::pread(cursor_.get(), bytes.data(), bytes.size(), 0) != kCursorBytes) return std::nullopt;
  wire::Reader reader(bytes);
  if (reader.take<std::uint32_t>() != kCursorMagic) return std::nullopt;
  if (reader.take<std::uint16_t>() != kCursorVersion) return std::nullopt;
  SpoolCursor cursor;
  cursor.number = reader.take<std::uint64_t>();
  cursor.offset = reader.take<std::uint64_t>();
  const auto checked = std::span(bytes).first(kCursorBytes - sizeof(std::uint32_t));
  if (reader.take<std::uint32_t>() != wire::crc32(checked)) return std::nullopt;
  return cursor;
}

std::optional<Error> SpoolFolder::write_cursor(const SpoolCursor& cursor) {
  const auto bytes = to_bytes(cursor);
  errno = ENOSPC;  // if it is written in part
  if (::pwrite(cursor_.get(), bytes.data(), bytes.size(), 0) == kCursorBytes) return std::nullopt;
  return system_error("cannot write " + cursor_path_.string(), errno);
}

std::optional<Error> SpoolFolder::sync() const {
  if (::fsync(folder_.get()) == 0 && ::fdatasync(cursor_.get()) == 0) return std::nullopt;
  return system_error("cannot sync the spool " + path_.string(), errno);
}

}  // namespace orbbuf
