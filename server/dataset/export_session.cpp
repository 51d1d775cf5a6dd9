// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/export_session.hpp"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <system_error>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/progress.hpp"
#include "server/recording/file_io.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

/// `out` while it is being filled: emptied again at the end of life unless it was kept.
class Output {
 public:
  explicit Output(fs::path folder) : folder_(std::move(folder)) {}
  ~Output() {
    if (!is_ours_) return;
    std::error_code ignored;  // there is nothing more to be done
    std::vector<fs::path> entries;
    fs::directory_iterator entry(folder_, ignored);
    for (; !ignored && entry != fs::directory_iterator(); entry.increment(ignored)) {
      entries.push_back(entry->path());
    }
    for (const fs::path& path : entries) fs::remove_all(path, ignored);
    if (is_new_) fs::remove(folder_, ignored);
  }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

  std::optional<Error> begin() {
    std::error_code failed;
    is_new_ = fs::create_directories(folder_, failed);
    const bool is_empty = !failed && fs::is_empty(folder_, failed);
    if (failed) return system_error("create " + folder_.string(), failed.value());
    if (!is_empty) return Error{folder_.string() + ": not empty; export makes a new folder"};
    is_ours_ = true;
    return std::nullopt;
  }

  /// True: by a hard link.
  Result<bool> add_image(const fs::path& from, const std::string& to) {
    if (auto error = make_folder_of(to)) return std::move(*error);
    if (::link(from.c_str(), (folder_ / to).c_str()) == 0) return true;
    const auto content = read_file(from);  // says why, if it was not the link
    if (!content) return content.error();
    if (auto error = add_file(to, content.value())) return std::move(*error);
    return false;
  }

  std::optional<Error> add_file(const std::string& to, std::span<const std::uint8_t> bytes) {
    if (auto error = make_folder_of(to)) return error;
    return write_file(folder_ / to, folder_ / session_names::kIncoming, bytes);
  }

  void keep() { is_ours_ = false; }

 private:
  std::optional<Error> make_folder_of(const std::string& to) {
    const fs::path parent = (folder_ / to).parent_path();
    if (parent == made_) return std::nullopt;
    std::error_code failed;
    fs::create_directories(parent, failed);
    if (failed) return system_error("create " + parent.string(), failed.value());
    made_ = parent;
    return std::nullopt;
  }

  const fs::path folder_;
  bool is_new_ = false;
  bool is_ours_ = false;
  fs::path made_;  // the last one
};

/// Adds to all times what the robot's clock was set by, and returns it. Changes none if one would
/// be out of range.
std::int64_t set_clock_right(RecordedSession& session) {
  const std::int64_t offset = session.closing ? session.closing->clock_offset_ns.value_or(0) : 0;
  std::int64_t ignored = 0;
  const auto fits = [&](const auto& item) {
    return !__builtin_add_overflow(item.capture_time_ns, offset, &ignored);
  };
  if (!std::ranges::all_of(session.frames, fits) || !std::ranges::all_of(session.drops, fits)) {
    return 0;
  }
  for (RecordedFrame& frame : session.frames) frame.capture_time_ns += offset;
  for (DropRecord& drop : session.drops) drop.capture_time_ns += offset;
  return offset;
}

std::optional<Error> reason_to_refuse(const RecordedSession& session, const Dataset& dataset) {
  if (session.frames.empty()) return Error{session.folder.string() + ": no frames"};
  const auto problems = problems_of_order(session);
  if (!problems.empty()) return Error{session.folder.string() + ": " + problems.front()};
  std::size_t missing = 0;
  std::string first;
  for (const Dataset::Image& image : dataset.images) {
    std::error_code ignored;  // then opening it says why
    if (fs::exists(session.folder / image.from, ignored) || ignored) continue;
    if (missing++ == 0) first = image.from;
  }
  if (missing == 0) return std::nullopt;
  return Error{fmt::format("{}: {} of its images are missing, {} first", session.folder.string(),
                           missing, first)};
}

}  // namespace

Result<ExportReport> export_session(const fs::path& folder, const fs::path& out, Layout layout,
                                    std::string_view extension) {
  auto session = read_recorded_session(folder);
  if (!session) return std::move(session).error();
  const auto clock_offset_ns = set_clock_right(session.value());
  Dataset dataset = lay_out(session.value(), layout, extension);
  if (auto error = reason_to_refuse(session.value(), dataset)) return std::move(*error);

  ExportReport report;
  report.frames = session.value().frames.size();
  report.notes = session.value().problems;
  if (clock_offset_ns != 0) {
    report.notes.push_back(fmt::format("the robot's clock was set: all times have {:+.3f} s added",
                                       static_cast<double>(clock_offset_ns) * 1e-9));
  }
  if (session.value().holds && session.value().holds->held > 0) {
    report.notes.push_back(
        fmt::format("the robot still has {} frames of this session", session.value().holds->held));
  }
  report.notes.insert(report.notes.end(), dataset.notes.begin(), dataset.notes.end());
  Output output(out);
  if (auto error = output.begin()) return std::move(*error);
  Progress progress("export", "images", dataset.images.size());
  for (const Dataset::Image& image : dataset.images) {
    const auto is_linked = output.add_image(folder / image.from, image.to);
    if (!is_linked) return is_linked.error();
    ++(is_linked.value() ? report.linked : report.copied);
    progress.add();
  }
  for (const Dataset::Text& text : dataset.texts) {
    if (auto error = output.add_file(text.to, as_bytes(text.content))) return std::move(*error);
  }
  output.keep();
  return report;
}

}  // namespace orbbuf
