// SPDX-License-Identifier: Apache-2.0
#include "server/session/views.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string>
#include <string_view>
#include <utility>

#include "common/as_bytes.hpp"
#include "common/file_io.hpp"
#include "common/log.hpp"
#include "common/sample.hpp"
#include "common/unique_fd.hpp"
#include "server/session/recovery.hpp"
#include "server/session/session_lines.hpp"
#include "server/session/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

/// A file that appears when it is complete.
class View {
 public:
  View(const fs::path& folder, const std::string& name)
      : path_(folder / name), temporary_(folder / (name + ".tmp")) {
    file_ = UniqueFd(::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
    if (!file_) error_ = system_error("create " + temporary_.string(), errno);
  }
  ~View() {
    if (file_) ::unlink(temporary_.c_str());
  }
  View(const View&) = delete;
  View& operator=(const View&) = delete;

  void add(std::string_view text) {
    text_ += text;
    if (text_.size() >= kBlockBytes) write();
  }

  /// The first error of all calls. A view without anything is no file.
  std::optional<Error> finish() {
    const bool is_empty = !is_begun_ && text_.empty();
    write();
    if (error_) return error_;
    if (is_empty) {
      ::unlink(path_.c_str());
      return std::nullopt;
    }
    if (auto error = close_written(std::move(file_), temporary_)) return error;
    return move_file(temporary_, path_);
  }

 private:
  static constexpr std::size_t kBlockBytes = 65536;

  void write() {
    is_begun_ = is_begun_ || !text_.empty();
    if (!error_) error_ = write_all(file_.get(), as_bytes(text_), temporary_);
    text_.clear();
  }

  const fs::path path_;
  const fs::path temporary_;
  UniqueFd file_;
  std::string text_;
  bool is_begun_ = false;
  std::optional<Error> error_;
};

std::uint64_t frames_of(const std::vector<DropRecord>& drops, DropReason reason) {
  std::uint64_t frames = 0;
  for (const DropRecord& drop : drops) frames += drop.reason == reason ? drop.frames : 0;
  return frames;
}

std::string session_text(const SessionSummary& summary, const std::vector<DropRecord>& drops) {
  const auto& [info, position, totals, end, late_end, is_closed, closing, account, part, removed] =
      summary;
  std::string text = session_lines::names(info);
  text += fmt::format("state {}\ncaptured {}\nlive {}\nlate {}\nreplaced {}\non_robot {}\n",
                      summary.has_ended() ? "ended" : "open", summary.captured(), totals.live,
                      totals.late, totals.replaced, account ? account->held : 0);
  for (const auto reason :
       {DropReason::kPolicy, DropReason::kBusy, DropReason::kFailed, DropReason::kShutdown,
        DropReason::kRefused, DropReason::kUnknown, DropReason::kLost}) {
    text += fmt::format("{} {}\n", to_string(reason), frames_of(drops, reason));
  }
  if (closing.clock_offset_ns)
    text += fmt::format("clock_offset_ns {}\n", *closing.clock_offset_ns);
  return text;
}

std::optional<Error> write_drops(const fs::path& folder, std::vector<DropRecord> drops,
                                 std::uint64_t most) {
  View view(folder, session_names::kDrops);
  if (!drops.empty()) view.add(std::string(kDropCsvHeader) + "\n");
  if (cut(drops, most)) {
    log_warn("{}: drops.csv has the first {} frames only", folder.string(), most);
  }
  for (const DropRecord& drop : drops) {
    for (Sequence i = drop.sequence; i < drop.end(); ++i) {
      view.add(to_csv({i, drop.capture_time_of(i), drop.reason}));
    }
  }
  return view.finish();
}

}  // namespace

Result<SampleTotals> write_samples(const fs::path& folder, const wire::StreamDeclaration& stream) {
  const std::string name = session_names::samples(stream);
  std::error_code failed;
  fs::create_directories((folder / name).parent_path(), failed);
  if (failed) return system_error("create a folder for " + name, failed.value());
  View view(folder, name);
  view.add(stream.codec == wire::kTopicCodec ? kMessageHeader : kEurocImuHeader);
  auto totals =
      for_each_sample(folder, stream, [&view](const Sample& sample) { view.add(to_line(sample)); });
  if (!totals) return totals.error();
  if (auto error = view.finish()) return std::move(*error);
  return totals;
}

std::optional<Error> make_views(const fs::path& folder, Views views) {
  const auto outline = read_outline(folder);
  if (!outline) return outline.error();
  const bool has_times = views == Views::kAll;
  std::optional<View> times;
  if (has_times) times.emplace(folder, session_names::kTimes);
  View checksums(folder, session_names::kChecksums);
  View qualities(folder, session_names::kQualities);
  bool is_first_quality = true;
  std::uint64_t frames = 0;
  const auto drops = for_each_frame(folder, outline.value(), [&](const RecordedFrame& frame) {
    ++frames;
    if (times) times->add(session_lines::times(frame));
    checksums.add(session_lines::checksums(frame));
    const std::string quality = session_lines::quality(frame);
    if (quality.empty()) return;
    if (std::exchange(is_first_quality, false)) qualities.add(session_lines::kQualityHeader);
    qualities.add(quality);
  });
  if (!drops) return drops.error();
  if (has_times && outline.value().problems.empty()) {
    if (auto error = set_strangers_aside(folder, outline.value().there)) return error;
  }
  if (auto error = checksums.finish()) return error;
  if (auto error = qualities.finish()) return error;
  if (auto error = write_drops(folder, drops.value(), most_drop_lines(frames))) return error;
  if (times) {
    if (auto error = times->finish()) return error;
  }
  std::string samples;
  for (const wire::StreamDeclaration& stream : outline.value().summary.info.streams) {
    const auto totals = has_times ? write_samples(folder, stream)
                                  : for_each_sample(folder, stream, [](const Sample&) {});
    if (!totals) return totals.error();
    const bool is_lost = totals.value().is_final || totals.value().lost() == 0;
    samples +=
        fmt::format("{} delivered {} on_robot {} {} {}\n", stream.name, totals.value().samples,
                    totals.value().on_robot, is_lost ? "lost" : "missing", totals.value().lost());
  }
  View session(folder, session_names::kSession);
  session.add(session_text(outline.value().summary, drops.value()) + samples);
  return session.finish();
}

}  // namespace orbbuf
