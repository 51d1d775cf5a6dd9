// SPDX-License-Identifier: Apache-2.0
#include "server/sink/backlog.hpp"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "common/drop_record.hpp"
#include "common/unique_fd.hpp"
#include "server/sink/session_names.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kBlockBytes = 4096;

/// What the pipe tells of a frame, from `SEQUENCE SECONDS EXPOSURE`.
std::optional<EncodedFrame> parse_line(std::string_view line) {
  EncodedFrame frame;
  const auto [rest, failed] =
      std::from_chars(line.data(), line.data() + line.size(), frame.sequence);
  const auto digits = static_cast<std::size_t>(rest - line.data());
  const auto second = line.rfind(' ');
  if (failed != std::errc{} || line.find(' ') != digits || second == digits) return std::nullopt;
  const auto time = parse_seconds(line.substr(digits + 1, second - digits - 1));
  if (!time) return std::nullopt;
  frame.capture_time_ns = *time;
  return frame;
}

/// Adds a whole file to `bytes`. Zero or an errno value.
int add_file(const std::filesystem::path& path, std::vector<std::uint8_t>& bytes) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd) return errno;
  std::array<std::uint8_t, 65'536> block;
  for (;;) {
    const ssize_t got = ::read(fd.get(), block.data(), block.size());
    if (got < 0) return errno;
    if (got == 0) return 0;
    bytes.insert(bytes.end(), block.begin(), block.begin() + got);
  }
}

}  // namespace

Result<FramePtr> Backlog::next(Sequence first) {
  const auto path = folder_ / session_names::kTimes;
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd) {
    if (errno == ENOENT) return FramePtr();
    return system_error("open " + path.string(), errno);
  }
  if (first < first_) offset_ = 0;
  first_ = first;
  std::array<char, kBlockBytes> block;
  for (;;) {
    const ssize_t got = ::pread(fd.get(), block.data(), block.size(), offset_);
    if (got < 0) return system_error("read " + path.string(), errno);
    std::string_view lines(block.data(), static_cast<std::size_t>(got));
    if (lines.find('\n') == lines.npos) return FramePtr();
    for (std::size_t end = 0; (end = lines.find('\n')) != lines.npos;) {
      const auto listed = parse_line(lines.substr(0, end));
      lines.remove_prefix(end + 1);
      offset_ += static_cast<off_t>(end + 1);
      if (!listed || listed->sequence < first) continue;
      auto frame = load(*listed);
      if (frame) return frame;
      spdlog::warn("{}: passed over frame {}: {}", folder_.string(), listed->sequence,
                   frame.error().text);
    }
  }
}

Result<FramePtr> Backlog::load(const EncodedFrame& listed) const {
  EncodedFrame frame = listed;
  const std::string name = session_names::image(frame.sequence);
  const auto left = folder_ / session_names::kImages / name;
  if (int failed = add_file(left, frame.jpeg)) return system_error("read " + left.string(), failed);
  frame.left_bytes = static_cast<std::uint32_t>(frame.jpeg.size());
  const auto right = folder_ / session_names::kRightImages / name;
  const int failed = add_file(right, frame.jpeg);
  if (failed != 0 && failed != ENOENT) return system_error("read " + right.string(), failed);
  return FramePtr(std::make_shared<const EncodedFrame>(std::move(frame)));
}

}  // namespace orbbuf
