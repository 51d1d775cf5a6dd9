// SPDX-License-Identifier: Apache-2.0
#include "server/recording/backlog.hpp"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "common/unique_fd.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {

Result<FramePtr> Backlog::next(Sequence first) {
  const auto path = folder_ / session_names::kTimes;
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd) {
    if (errno == ENOENT) return FramePtr();
    return system_error("open " + path.string(), errno);
  }
  if (first < first_) offset_ = 0;
  first_ = first;
  std::array<char, 4096> block;
  for (;;) {
    const ssize_t got = ::pread(fd.get(), block.data(), block.size(), offset_);
    if (got < 0) return system_error("read " + path.string(), errno);
    std::string_view lines(block.data(), static_cast<std::size_t>(got));
    if (lines.find('\n') == lines.npos) return FramePtr();
    for (std::size_t end = 0; (end = lines.find('\n')) != lines.npos;) {
      const auto listed = session_lines::parse_times(lines.substr(0, end));
      lines.remove_prefix(end + 1);
      offset_ += static_cast<off_t>(end + 1);
      if (!listed || listed->sequence < first) continue;
      auto frame = load(listed->sequence, listed->capture_time_ns);
      if (frame) return frame;
      spdlog::warn("{}: passed over frame {}: {}", folder_.string(), listed->sequence,
                   frame.error().text);
    }
  }
}

Result<FramePtr> Backlog::load(Sequence sequence, std::int64_t capture_time_ns) const {
  const std::string name = session_names::image(sequence);
  auto left = read_file(folder_ / session_names::kImages / name);
  if (!left) return std::move(left).error();
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = capture_time_ns;
  frame.jpeg = std::move(left).value();
  frame.left_bytes = static_cast<std::uint32_t>(frame.jpeg.size());
  const auto right_path = folder_ / session_names::kRightImages / name;
  std::error_code ignored;  // then reading says why
  if (std::filesystem::exists(right_path, ignored) || ignored) {
    const auto right = read_file(right_path);
    if (!right) return right.error();
    frame.jpeg.insert(frame.jpeg.end(), right.value().begin(), right.value().end());
  }
  return FramePtr(std::make_shared<const EncodedFrame>(std::move(frame)));
}

}  // namespace orbbuf
