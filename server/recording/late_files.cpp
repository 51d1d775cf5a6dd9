// SPDX-License-Identifier: Apache-2.0
#include "server/recording/late_files.hpp"

#include <unistd.h>

#include <algorithm>
#include <span>
#include <string>
#include <system_error>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/wire.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/late_list.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

session_lines::Late line_of(const EncodedFrame& frame, std::int64_t arrived_ns) {
  session_lines::Late late;
  late.sequence = frame.sequence;
  late.capture_time_ns = frame.capture_time_ns;
  late.exposure_ms = session_lines::exposure_ms(frame.exposure_ns);
  late.crc = frame.is_stereo() ? wire::crc32(frame.left()) : frame.jpeg_crc;
  if (frame.is_stereo()) late.crc_right = wire::crc32(frame.right());
  late.arrived_ns = arrived_ns;
  late.quality = frame.quality;
  return late;
}

std::optional<Error> make_folder(const fs::path& folder) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed) return system_error("create " + folder.string(), failed.value());
  return std::nullopt;
}

bool has_image(const fs::path& path, std::span<const std::uint8_t> bytes) {
  std::error_code ignored;  // then it is as good as missing
  if (fs::file_size(path, ignored) != bytes.size() || ignored) return false;
  const auto content = read_file(path);
  return content && std::ranges::equal(content.value(), bytes);
}

}  // namespace

LateFiles::LateFiles(fs::path folder)
    : folder_(std::move(folder)),
      temporary_(folder_ / session_names::kLate / session_names::kIncoming),
      list_(folder_ / session_names::kLateList, std::string(session_lines::kLateHeader)) {}

std::optional<Error> LateFiles::open() {
  if (is_open_) return std::nullopt;
  const auto late = recover_late(folder_);
  if (!late) return late.error();
  arrived_ = numbers_of(late.value());
  is_open_ = true;
  return std::nullopt;
}

Result<bool> LateFiles::write(const EncodedFrame& frame, std::int64_t arrived_ns) {
  if (auto error = open()) return std::move(*error);
  if (arrived_.contains(frame.sequence)) return false;
  const auto is_there = is_delivered(frame);
  if (!is_there) return is_there.error();
  if (is_there.value()) return false;
  auto error = write_images(frame);
  if (!error) error = list_.append(session_lines::to_csv(line_of(frame, arrived_ns)) + '\n');
  if (error) {
    for (const auto& image :
         {session_names::left_image(frame.sequence), session_names::right_image(frame.sequence)}) {
      ::unlink((folder_ / session_names::late_image(image)).c_str());
    }
    return std::move(*error);
  }
  arrived_.insert(frame.sequence);
  return true;
}

/// An image without a line in times.txt was in the middle of being written, and a line may have
/// lost its image in a power cut.
Result<bool> LateFiles::is_delivered(const EncodedFrame& frame) {
  const fs::path left = folder_ / session_names::left_image(frame.sequence);
  const fs::path right = folder_ / session_names::right_image(frame.sequence);
  if (!has_image(left, frame.left())) return false;
  if (frame.is_stereo() && !has_image(right, frame.right())) return false;
  std::error_code ignored;  // no such file; else reading it says why
  const auto bytes = fs::file_size(folder_ / session_names::kTimes, ignored);
  if (bytes != times_bytes_) {
    auto numbers = read_times_numbers(folder_);
    if (!numbers) return std::move(numbers).error();
    delivered_ = std::move(numbers).value();
    times_bytes_ = bytes;
  }
  return delivered_.contains(frame.sequence);
}

/// The folders are made again if needed: a merge removes them.
std::optional<Error> LateFiles::write_images(const EncodedFrame& frame) const {
  const auto write = [&](const std::string& image, std::span<const std::uint8_t> bytes) {
    const fs::path path = folder_ / session_names::late_image(image);
    auto error = make_folder(path.parent_path());
    return error ? error : write_file(path, temporary_, bytes);
  };
  auto error = write(session_names::left_image(frame.sequence), frame.left());
  if (error || !frame.is_stereo()) return error;
  return write(session_names::right_image(frame.sequence), frame.right());
}

std::optional<Error> LateFiles::note(const RobotHolds& holds) {
  const fs::path path = folder_ / session_names::kSpool;
  std::error_code ignored;  // then writing says why
  if (!fs::exists(folder_, ignored)) return std::nullopt;
  const auto text = read_text(path);
  if (!text) return text.error();
  auto known = holds_from_csv(text.value());
  if (!known && text.value().empty()) known = RobotHolds{};
  if (known && known->held == holds.held && (holds.held == 0 || known->first == holds.first)) {
    return std::nullopt;
  }
  return write_file(path, folder_ / "spool.tmp", as_bytes(to_csv(holds)));
}

}  // namespace orbbuf
