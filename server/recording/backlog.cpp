// SPDX-License-Identifier: Apache-2.0
#include "server/recording/backlog.hpp"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

#include "common/unique_fd.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {

Result<std::optional<std::string_view>> Backlog::Lines::next() {
  constexpr std::size_t kBlockBytes = 4096;
  auto end = block_.find('\n', begin_);
  if (end == block_.npos) {
    begin_ = 0;
    block_.clear();
    const UniqueFd fd(::open(path_.c_str(), O_RDONLY | O_CLOEXEC));
    if (!fd && errno == ENOENT) return std::nullopt;
    if (!fd) return system_error("open " + path_.string(), errno);
    block_.resize(kBlockBytes);
    const ssize_t got = ::pread(fd.get(), block_.data(), block_.size(), offset_);
    if (got < 0) return system_error("read " + path_.string(), errno);
    block_.resize(static_cast<std::size_t>(got));
    end = block_.find('\n');
    if (end == block_.npos) return std::nullopt;
  }
  const auto line = std::string_view(block_).substr(begin_, end - begin_);
  offset_ += static_cast<off_t>(line.size() + 1);
  begin_ = end + 1;
  return line;
}

void Backlog::Lines::rewind() {
  offset_ = 0;
  block_.clear();
  begin_ = 0;
}

Backlog::Backlog(std::filesystem::path folder)
    : folder_(std::move(folder)),
      times_(folder_ / session_names::kTimes),
      qualities_(folder_ / session_names::kQualities) {}

Result<FramePtr> Backlog::next(Sequence first) {
  if (first < first_) {
    times_.rewind();
    qualities_.rewind();
    quality_.reset();
  }
  first_ = first;
  for (;;) {
    const auto line = times_.next();
    if (!line) return line.error();
    if (!line.value()) return FramePtr();
    const auto listed = session_lines::parse_times(*line.value());
    if (!listed || listed->sequence < first) continue;
    auto frame = load(listed->sequence, listed->capture_time_ns);
    if (frame) return frame;
    spdlog::warn("{}: passed over frame {}: {}", folder_.string(), listed->sequence,
                 frame.error().text);
  }
}

/// The lines are in the order of the frames. Only those of late frames stand behind them.
session_lines::Quality Backlog::quality_of(Sequence sequence) {
  session_lines::Quality found{sequence};
  while (!quality_ || quality_->sequence <= sequence) {
    if (quality_ && quality_->sequence == sequence) found = *quality_;
    const auto line = qualities_.next();
    if (!line || !line.value()) break;
    quality_ = session_lines::parse_quality(*line.value());
  }
  return found;
}

Result<FramePtr> Backlog::load(Sequence sequence, std::int64_t capture_time_ns) {
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
  const auto quality = quality_of(sequence);
  frame.quality = quality.quality;
  frame.whole_bytes = quality.whole_bytes;
  frame.whole_crc = quality.whole_crc;
  return FramePtr(std::make_shared<const EncodedFrame>(std::move(frame)));
}

}  // namespace orbbuf
