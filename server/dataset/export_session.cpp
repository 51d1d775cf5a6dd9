// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/export_session.hpp"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <optional>
#include <span>
#include <system_error>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/decimal.hpp"
#include "common/file_io.hpp"
#include "common/progress.hpp"
#include "common/sample.hpp"
#include "server/dataset/mcap/recording.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTemporary = "incoming.tmp";

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
    return write_file(folder_ / to, folder_ / kTemporary, bytes);
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
  const std::int64_t offset = session.summary.closing.clock_offset_ns.value_or(0);
  std::int64_t ignored = 0;
  const auto fits = [&](std::int64_t time_ns) {
    return !__builtin_add_overflow(time_ns, offset, &ignored);
  };
  if (!std::ranges::all_of(session.frames, fits, &RecordedFrame::capture_time_ns) ||
      !std::ranges::all_of(session.drops, fits, &DropRecord::capture_time_ns) ||
      !std::ranges::all_of(session.drops, fits, &DropRecord::last_capture_time_ns)) {
    return 0;
  }
  for (RecordedFrame& frame : session.frames) frame.capture_time_ns += offset;
  for (DropRecord& drop : session.drops) {
    drop.capture_time_ns += offset;
    drop.last_capture_time_ns += offset;
  }
  return offset;
}

std::optional<Error> reason_to_refuse(const RecordedSession& session) {
  const auto refuse = [&](const std::string& why) {
    return Error{session.folder.string() + ": " + why};
  };
  if (session.frames.empty()) return refuse("no frames");
  const auto back = std::ranges::adjacent_find(session.frames, std::ranges::greater_equal(),
                                               &RecordedFrame::capture_time_ns);
  if (back != session.frames.end()) {
    return refuse(fmt::format("frame {} was taken at {} s, not after frame {}",
                              std::next(back)->sequence,
                              format_seconds(std::next(back)->capture_time_ns), back->sequence));
  }
  std::size_t missing = 0;
  std::string first;
  const auto look_for = [&](const std::string& image) {
    std::error_code ignored;  // then opening it says why
    if (fs::exists(session.folder / image, ignored) || ignored) return;
    if (missing++ == 0) first = image;
  };
  for (const RecordedFrame& frame : session.frames) {
    look_for(session_names::left_image(frame.sequence));
    if (frame.is_stereo()) look_for(session_names::right_image(frame.sequence));
  }
  if (missing == 0) return std::nullopt;
  return refuse(
      fmt::format("{} of its images are missing, {} first{}", missing, first,
                  session.summary.has_removed() ? ": they are in the MCAP recording only" : ""));
}

std::vector<std::string> notes_of(const RecordedSession& session, std::int64_t clock_offset_ns) {
  std::vector<std::string> notes = session.problems;
  if (clock_offset_ns != 0) {
    notes.push_back(fmt::format("the robot's clock was set: all times have {:+.3f} s added",
                                static_cast<double>(clock_offset_ns) * 1e-9));
  }
  if (session.summary.is_held()) {
    const std::uint64_t frames = session.summary.account->held;
    notes.push_back(fmt::format("the robot still has {} of this session",
                                frames > 0 ? fmt::format("{} frames", frames) : "samples"));
  }
  return notes;
}

/// Memory: 100 bytes a sample.
std::optional<Error> add_euroc_samples(const RecordedSession& session, std::int64_t offset_ns,
                                       Output& output) {
  for (const wire::StreamDeclaration& stream : session.summary.info.streams) {
    if (stream.codec == wire::kTopicCodec) continue;
    std::string text(kEurocImuHeader);
    const auto totals = for_each_sample(session.folder, stream, [&](Sample sample) {
      if (__builtin_add_overflow(sample.time_ns, offset_ns, &sample.time_ns)) return;
      text += to_euroc_line(sample);
    });
    if (!totals) return totals.error();
    const std::string to = "mav0/" + session_names::samples(stream);
    if (auto error = output.add_file(to, as_bytes(text))) return error;
  }
  return std::nullopt;
}

std::optional<Error> write_recording(const RecordedSession& session, std::int64_t offset_ns,
                                     const fs::path& path, ExportReport& report) {
  auto made = mcap::Recording::create(path, session.summary.info);
  if (!made) return std::move(made).error();
  mcap::Recording& recording = made.value();
  Progress progress("export", "frames", session.frames.size());
  for (const RecordedFrame& recorded : session.frames) {
    auto frame = read_images(session.folder, recorded);
    if (!frame) return std::move(frame).error();
    if (const auto added = recording.add(frame.value()); !added) return added.error();
    report.copied += recorded.is_stereo() ? 2 : 1;
    progress.add();
  }
  for (const DropRecord& drop : session.drops) {
    if (const auto added = recording.add(drop); !added) return added.error();
  }
  for (const wire::StreamDeclaration& stream : session.summary.info.streams) {
    std::uint64_t number = 0;  // what was lost is not left out
    std::optional<Error> failed;
    const auto totals = for_each_sample(session.folder, stream, [&](Sample sample) {
      // Its publisher stamped a message by the clock that was set.
      const auto offset = sample.message ? 0 : offset_ns;
      if (failed || __builtin_add_overflow(sample.time_ns, offset, &sample.time_ns)) return;
      const auto added = recording.add(stream.id, number++, sample);
      if (!added) failed = added.error();
    });
    if (!totals) return totals.error();
    if (failed) return failed;
  }
  if (!recording.problem().empty())
    report.notes.push_back("no calibration: " + recording.problem());
  return recording.finish(0);
}

}  // namespace

Result<ExportReport> export_session(const fs::path& folder, const fs::path& out, Layout layout,
                                    std::string_view extension) {
  auto read = read_session(folder);
  if (!read) return std::move(read).error();
  RecordedSession& session = read.value();
  const auto most_drops = most_drop_lines(session.frames.size());
  const bool are_drops_cut = cut(session.drops, most_drops);
  const auto clock_offset_ns = set_clock_right(session);
  if (auto error = reason_to_refuse(session)) return std::move(*error);
  ExportReport report;
  report.frames = session.frames.size();
  report.notes = notes_of(session, clock_offset_ns);
  if (are_drops_cut) {
    report.notes.push_back(fmt::format("of what was dropped the first {} frames only", most_drops));
  }
  Output output(out);
  if (auto error = output.begin()) return std::move(*error);
  if (layout == Layout::kMcap) {
    const auto name = session.summary.info.session_id + ".mcap";
    if (auto error = write_recording(session, clock_offset_ns, out / name, report)) {
      return std::move(*error);
    }
    output.keep();
    return report;
  }
  const Dataset dataset = lay_out(session, layout, extension);
  report.notes.insert(report.notes.end(), dataset.notes.begin(), dataset.notes.end());
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
  if (layout == Layout::kEuroc) {
    if (auto error = add_euroc_samples(session, clock_offset_ns, output)) return std::move(*error);
  }
  output.keep();
  return report;
}

}  // namespace orbbuf
