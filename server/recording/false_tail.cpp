// SPDX-License-Identifier: Apache-2.0
#include "server/recording/false_tail.hpp"

#include <algorithm>
#include <charconv>
#include <map>
#include <string_view>
#include <system_error>
#include <vector>

#include "common/wire.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

/// By image; of two lines for one image the last counts.
std::map<std::string, std::uint32_t, std::less<>> checksums_of(std::string_view text) {
  std::map<std::string, std::uint32_t, std::less<>> checksums;
  for (std::size_t end = 0; (end = text.find('\n')) != text.npos; text.remove_prefix(end + 1)) {
    const auto checksum = session_lines::parse_checksum(text.substr(0, end));
    if (checksum) checksums[std::string(checksum->image)] = checksum->crc;
  }
  return checksums;
}

class Images {
 public:
  Images(fs::path folder, std::string_view checksums)
      : folder_(std::move(folder)), checksums_(checksums_of(checksums)) {
    const auto number = checksums.substr(std::min(checksums.find('/') + 1, checksums.size()));
    std::from_chars(number.data(), number.data() + number.size(), first_listed_);
  }

  /// Lines of checksums are lost from the end only: frames before the first one never had any.
  bool is_whole(Sequence sequence) const {
    const auto left = session_names::left_image(sequence);
    const auto right = session_names::right_image(sequence);
    if (checksums_.empty() || sequence < first_listed_) return is_something(left);
    return matches(left) && (!checksums_.contains(right) || matches(right));
  }

 private:
  bool is_something(const std::string& image) const {
    std::error_code failed;
    return fs::file_size(folder_ / image, failed) > 0 && !failed;
  }
  bool matches(const std::string& image) const {
    const auto checksum = checksums_.find(image);
    if (checksum == checksums_.end()) return false;
    const auto content = read_file(folder_ / image);
    return content && wire::crc32(content.value()) == checksum->second;
  }

  const fs::path folder_;
  const std::map<std::string, std::uint32_t, std::less<>> checksums_;
  Sequence first_listed_ = 0;
};

struct Line {
  std::size_t offset;
  Sequence sequence;
};

std::vector<Line> lines_of(std::string_view times) {
  std::vector<Line> lines;
  std::size_t offset = 0;
  for (std::size_t end = 0; (end = times.find('\n', offset)) != times.npos; offset = end + 1) {
    const auto line = session_lines::parse_times(times.substr(offset, end - offset));
    if (line) lines.push_back({offset, line->sequence});
  }
  return lines;
}

}  // namespace

Result<FalseTail> find_false_tail(const fs::path& folder) {
  const auto times = read_text(folder / session_names::kTimes);
  if (!times) return times.error();
  const auto checksums = read_text(folder / session_names::kChecksums);
  if (!checksums) return checksums.error();
  const Images images(folder, checksums.value());
  const std::vector<Line> lines = lines_of(times.value());
  std::size_t first_false = lines.size();
  std::size_t run = 0;
  for (std::size_t i = lines.size(); i > 0 && run < kTrueRun; --i) {
    const bool is_whole = images.is_whole(lines[i - 1].sequence);
    run = is_whole ? run + 1 : 0;
    if (!is_whole) first_false = i - 1;
  }
  FalseTail tail;
  if (first_false == lines.size()) return tail;
  tail.offset = lines[first_false].offset;
  tail.lines = times.value().substr(lines[first_false].offset);
  tail.frames = lines.size() - first_false;
  if (first_false > 0) tail.last_true = lines[first_false - 1].sequence;
  return tail;
}

Result<bool> move_to_orphans(const fs::path& folder, const std::string& name) {
  std::error_code failed;
  if (!fs::exists(folder / name, failed)) return false;
  const fs::path wanted = folder / session_names::kOrphans / name;
  fs::create_directories(wanted.parent_path(), failed);
  fs::path to = wanted;
  for (int i = 1; !failed && fs::exists(to, failed); ++i)
    to = wanted.string() + "." + std::to_string(i);
  if (!failed) fs::rename(folder / name, to, failed);
  if (failed)
    return system_error("move " + (folder / name).string() + " to orphans", failed.value());
  return true;
}

}  // namespace orbbuf
