// SPDX-License-Identifier: Apache-2.0
#include "server/recording/late_list.hpp"

#include <spdlog/spdlog.h>

#include <cstddef>
#include <string_view>
#include <system_error>
#include <utility>

#include "common/wire.hpp"
#include "server/recording/false_tail.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/line_file.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using session_lines::Late;

struct ListedLate {
  Late frame;
  std::size_t offset = 0;  // of its line in late.csv
};

template <class Take>
void for_each_line(std::string_view text, Take take) {
  std::size_t offset = 0;
  for (std::size_t end = 0; (end = text.find('\n', offset)) != text.npos; offset = end + 1) {
    take(text.substr(offset, end - offset), offset);
  }
}

std::vector<ListedLate> parse(std::string_view text) {
  std::vector<ListedLate> listed;
  for_each_line(text, [&](std::string_view line, std::size_t offset) {
    if (auto frame = session_lines::parse_late(line)) listed.push_back({std::move(*frame), offset});
  });
  return listed;
}

LateList frames_of(std::vector<ListedLate> listed) {
  LateList frames;
  frames.reserve(listed.size());
  for (ListedLate& line : listed) frames.push_back(std::move(line.frame));
  return frames;
}

bool matches(const fs::path& folder, const std::string& image, std::uint32_t crc) {
  const auto content = read_file(folder / place_of_late_image(folder, image));
  return content && wire::crc32(content.value()) == crc;
}

/// The oldest line that is false, or the end.
std::size_t first_false_line(const fs::path& folder, const std::vector<ListedLate>& listed,
                             const SequenceSet& merged) {
  std::size_t first_false = listed.size();
  std::size_t run = 0;
  for (std::size_t i = listed.size(); i > 0 && run < kTrueRun; --i) {
    const Late& frame = listed[i - 1].frame;
    const bool is_true = merged.contains(frame.sequence) || is_whole(folder, frame);
    run = is_true ? run + 1 : 0;
    if (!is_true) first_false = i - 1;
  }
  return first_false;
}

/// Images first: were it the other way round, a kill in between would leave images that stay.
std::optional<Error> set_aside(const fs::path& folder, std::string_view text,
                               const std::vector<ListedLate>& listed, std::size_t first_false) {
  for (std::size_t i = first_false; i < listed.size(); ++i) {
    const Sequence sequence = listed[i].frame.sequence;
    for (const auto& image :
         {session_names::left_image(sequence), session_names::right_image(sequence)}) {
      const auto moved = move_to_orphans(folder, session_names::late_image(image));
      if (!moved) return moved.error();
    }
  }
  const std::size_t offset = listed[first_false].offset;
  const fs::path orphans = folder / session_names::kOrphans;
  std::error_code failed;
  fs::create_directories(orphans, failed);
  if (failed) return system_error("create " + orphans.string(), failed.value());
  LineFile kept(orphans / session_names::kLateList);
  if (auto error = kept.append(text.substr(offset))) return error;
  const fs::path list = folder / session_names::kLateList;
  fs::resize_file(list, offset, failed);
  if (failed) return system_error("truncate " + list.string(), failed.value());
  spdlog::error(
      "{}: {} frames at the end of late.csv are not whole; their lines are in orphans/ now, and "
      "the robot sends them again",
      folder.string(), listed.size() - first_false);
  return std::nullopt;
}

}  // namespace

Result<LateList> read_late(const fs::path& folder) {
  const auto text = read_text(folder / session_names::kLateList);
  if (!text) return text.error();
  return frames_of(parse(text.value()));
}

Result<LateList> recover_late(const fs::path& folder) {
  LineFile list(folder / session_names::kLateList);
  if (auto recovered = list.recover(); !recovered) return std::move(recovered).error();
  const auto text = read_text(list.path());
  if (!text) return text.error();
  auto listed = parse(text.value());
  if (listed.empty()) return LateList{};
  const auto merged = read_times_numbers(folder);
  if (!merged) return merged.error();
  const std::size_t first_false = first_false_line(folder, listed, merged.value());
  if (first_false < listed.size()) {
    if (auto error = set_aside(folder, text.value(), listed, first_false)) {
      return std::move(*error);
    }
    listed.erase(listed.begin() + static_cast<std::ptrdiff_t>(first_false), listed.end());
  }
  return frames_of(std::move(listed));
}

SequenceSet numbers_of(const LateList& late) {
  SequenceSet numbers;
  for (const Late& frame : late) numbers.insert(frame.sequence);
  return numbers;
}

Result<SequenceSet> read_times_numbers(const fs::path& folder) {
  const auto text = read_text(folder / session_names::kTimes);
  if (!text) return text.error();
  SequenceSet numbers;
  for_each_line(text.value(), [&](std::string_view line, std::size_t /*offset*/) {
    if (const auto times = session_lines::parse_times(line)) numbers.insert(times->sequence);
  });
  return numbers;
}

std::string place_of_late_image(const fs::path& folder, const std::string& image) {
  std::string late = session_names::late_image(image);
  std::error_code ignored;  // then reading says why
  const bool is_moved = !fs::exists(folder / late, ignored) && fs::exists(folder / image, ignored);
  return is_moved ? image : late;
}

bool is_whole(const fs::path& folder, const Late& late) {
  return matches(folder, session_names::left_image(late.sequence), late.crc) &&
         (!late.crc_right ||
          matches(folder, session_names::right_image(late.sequence), *late.crc_right));
}

}  // namespace orbbuf
