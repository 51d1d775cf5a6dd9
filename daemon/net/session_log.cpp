// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/session_log.hpp"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <fstream>
#include <iterator>
#include <tuple>
#include <utility>

#include "common/decimal.hpp"
#include "common/error.hpp"
#include "common/log.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kSyncInterval{10};
constexpr std::string_view kStateHeader =
    "state,robot,captured,last_capture_ns,next_sequence,next_drop\n";
constexpr std::string_view kStateExtension = ".state";
constexpr std::string_view kRecordsExtension = ".csv";

constexpr std::array<std::string_view, 3> kStages = {"open ", "ended", "done "};  // by Stage

UniqueFd open_file(const fs::path& path, int flags) {
  constexpr mode_t kMode = 0644;
  return UniqueFd(::open(path.c_str(), flags | O_CLOEXEC, kMode));
}

bool lock(const UniqueFd& file) { return file && ::flock(file.get(), LOCK_EX | LOCK_NB) == 0; }

std::string read_all(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Up to the first line that is not one: the last may have been written in part.
std::vector<DropRecord> read_records(const fs::path& path) {
  std::vector<DropRecord> records;
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line) || line != kDropCsvHeader) return records;
  while (std::getline(file, line) && !file.eof()) {
    const auto record = drop_from_csv(line);
    if (!record) break;
    records.push_back(*record);
  }
  return records;
}

/// A session in the folder whose process has ended.
struct Found {
  fs::path state;
  fs::file_time_type time;
  std::uint64_t bytes = 0;

  fs::path records() const { return fs::path(state).replace_extension(kRecordsExtension); }
};

/// The oldest first. Other files than ours are not looked at.
std::vector<Found> find_sessions(const fs::path& folder) {
  std::vector<Found> found;
  std::error_code failed;
  for (auto entry = fs::directory_iterator(folder, failed);
       !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    const fs::path& path = entry->path();
    if (path.extension() != kStateExtension || !wire::is_valid_id(path.stem().string())) continue;
    if (!lock(open_file(path, O_RDONLY))) continue;
    Found session{path, fs::last_write_time(path, failed), 0};
    const auto bytes = fs::file_size(session.records(), failed);
    session.bytes = failed ? 0 : bytes;
    found.push_back(std::move(session));
    failed.clear();
  }
  std::sort(found.begin(), found.end(), [](const Found& one, const Found& other) {
    return std::tie(one.time, one.state) < std::tie(other.time, other.state);
  });
  return found;
}

/// Makes room for one more session.
void remove_oldest(const fs::path& folder) {
  auto found = find_sessions(folder);
  std::reverse(found.begin(), found.end());
  std::uint64_t bytes = 0;
  std::size_t kept = 0;
  for (const Found& session : found) {
    bytes += session.bytes;
    if (++kept < SessionLog::kMostSessions && bytes <= SessionLog::kMostBytes) continue;
    std::error_code ignored;  // the next start tries again
    fs::remove(session.records(), ignored);
    fs::remove(session.state, ignored);
  }
}

bool append(int file, std::string_view text) {
  while (!text.empty()) {
    const ssize_t done = ::write(file, text.data(), text.size());
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) return false;
    text.remove_prefix(static_cast<std::size_t>(done));
  }
  return true;
}

bool put(int file, std::string_view state) {
  return ::pwrite(file, state.data(), state.size(), 0) == static_cast<ssize_t>(state.size());
}

}  // namespace

std::string to_csv(const SessionState& state) {
  const auto& [next_sequence, next_drop] = state.confirmed;
  return fmt::format("{}{},{},{:020},{:020},{:020},{:020}\n", kStateHeader,
                     kStages[static_cast<std::size_t>(state.stage)], state.robot_id, state.captured,
                     std::max<std::int64_t>(state.last_capture_time_ns, 0), next_sequence,
                     next_drop);
}

std::optional<SessionState> state_from_csv(std::string_view text) {
  if (!text.starts_with(kStateHeader) || !text.ends_with('\n')) return std::nullopt;
  text.remove_prefix(kStateHeader.size());
  text.remove_suffix(1);
  std::vector<std::string_view> fields;
  for (std::size_t comma = 0; comma != std::string_view::npos;) {
    comma = text.find(',');
    fields.push_back(text.substr(0, comma));
    if (comma != std::string_view::npos) text.remove_prefix(comma + 1);
  }
  constexpr std::size_t kFields = 6;
  if (fields.size() != kFields) return std::nullopt;
  const auto stage = std::find(kStages.begin(), kStages.end(), fields[0]);
  const auto captured = parse_digits(fields[2]);
  const auto last_capture_ns = parse_digits(fields[3]);
  const auto next_sequence = parse_digits(fields[4]);
  const auto next_drop = parse_digits(fields[5]);
  if (stage == kStages.end() || !captured || !last_capture_ns || !next_sequence || !next_drop) {
    return std::nullopt;
  }
  SessionState state;
  state.stage = static_cast<SessionState::Stage>(stage - kStages.begin());
  state.robot_id = fields[1];
  state.captured = *captured;
  state.last_capture_time_ns = static_cast<std::int64_t>(*last_capture_ns);
  state.confirmed = {*next_sequence, *next_drop};
  return state;
}

SessionLog::SessionLog(const fs::path& folder, std::string robot_id,
                       const std::string& session_id) {
  if (folder.empty()) return;
  state_.robot_id = std::move(robot_id);
  path_ = folder / (session_id + std::string(kRecordsExtension));
  const fs::path state = folder / (session_id + std::string(kStateExtension));
  std::error_code failed;
  fs::create_directories(folder, failed);
  remove_oldest(folder);
  records_file_ = open_file(path_, O_WRONLY | O_CREAT | O_APPEND);
  if (records_file_) state_file_ = open_file(state, O_RDWR | O_CREAT);
  if (!lock(state_file_) || !append(records_file_.get(), std::string(kDropCsvHeader) + '\n') ||
      !put(state_file_.get(), to_csv(state_))) {
    give_up("cannot write the drop log " + path_.string());
    return;
  }
  writer_ = std::jthread([this](const std::stop_token& stop) { write_until_end(stop); });
}

SessionLog::~SessionLog() = default;

void SessionLog::add(std::span<const DropRecord> records) {
  if (records.empty() || !writer_.joinable() || is_full_) return;
  std::string lines;
  for (const DropRecord& record : records) lines.append(to_csv(record)).append(1, '\n');
  const std::lock_guard lock(mutex_);
  is_full_ =
      bytes_ + lines.size() > kMostBytes || pending_records_.size() + lines.size() > kMostPending;
  if (is_full_) {
    spdlog::warn("the drop log {} ends here: {}; the server still gets all records", path_.string(),
                 bytes_ + lines.size() > kMostBytes ? "it has 8 MiB" : "the disk does not take it");
    return;
  }
  bytes_ += lines.size();
  pending_records_ += lines;
  changed_.notify_one();
}

void SessionLog::note(std::uint64_t captured, std::int64_t last_capture_time_ns,
                      const wire::Position& confirmed) {
  if (captured == state_.captured && confirmed == state_.confirmed) return;
  state_.captured = captured;
  state_.last_capture_time_ns = last_capture_time_ns;
  state_.confirmed = confirmed;
  wake();
}

void SessionLog::end(bool complete) {
  state_.stage = complete ? SessionState::Stage::kDone : SessionState::Stage::kEnded;
  wake();
}

void SessionLog::wake() {
  if (!writer_.joinable()) return;
  const std::lock_guard lock(mutex_);
  pending_state_ = to_csv(state_);
  changed_.notify_one();
}

void SessionLog::write_until_end(const std::stop_token& stop) {
  name_this_thread("drops");
  std::chrono::steady_clock::time_point synced;
  std::unique_lock lock(mutex_);
  while (changed_.wait(lock, stop,
                       [this] { return !pending_records_.empty() || !pending_state_.empty(); })) {
    const std::string records = std::exchange(pending_records_, {});
    const std::string state = std::exchange(pending_state_, {});
    lock.unlock();
    if (!write(records, state)) return;
    if (const auto now = std::chrono::steady_clock::now(); now >= synced + kSyncInterval) {
      sync();
      synced = now;
    }
    lock.lock();
  }
  sync();
}

/// The records first: the state must not say more than they do.
bool SessionLog::write(std::string_view records, std::string_view state) {
  if (append(records_file_.get(), records) && (state.empty() || put(state_file_.get(), state))) {
    return true;
  }
  give_up("cannot write the drop log " + path_.string());
  return false;
}

void SessionLog::sync() const {
  ::fdatasync(records_file_.get());
  ::fdatasync(state_file_.get());
}

void SessionLog::give_up(const std::string& attempt) {
  spdlog::warn("{}; the robot keeps no drop log of this session",
               system_error(attempt, errno).text);
}

std::vector<EarlierSession> find_earlier_sessions(const fs::path& folder) {
  std::vector<EarlierSession> earlier;
  if (folder.empty()) return earlier;
  for (const Found& found : find_sessions(folder)) {
    const auto state = state_from_csv(read_all(found.state));
    if (!state || state->stage == SessionState::Stage::kDone) continue;
    if (!wire::is_valid_id(state->robot_id)) continue;
    const fs::path records = found.records();
    earlier.push_back({records, found.state.stem().string(), *state, read_records(records)});
  }
  return earlier;
}

std::string describe(const EarlierSession& session) {
  const auto& [next_sequence, next_drop] = session.state.confirmed;
  const bool has_frames = session.state.captured > next_sequence;
  const bool has_drops = session.records.size() > next_drop;
  if (!has_frames && !has_drops) return "";
  std::string what;
  if (has_frames) what = fmt::format("frames {} to {}", next_sequence, session.state.captured - 1);
  if (has_frames && has_drops) what += " and ";
  if (has_drops) what += fmt::format("{} drop records", session.records.size() - next_drop);
  return fmt::format("session {} ended with {} not confirmed by the server: see {}",
                     session.session_id, what, session.file.string());
}

void settle(const EarlierSession& session) {
  SessionState state = session.state;
  state.stage = SessionState::Stage::kDone;
  const UniqueFd file =
      open_file(fs::path(session.file).replace_extension(kStateExtension), O_WRONLY);
  if (file && put(file.get(), to_csv(state))) return;
  spdlog::warn("{}",
               system_error("cannot write the state of session " + session.session_id, errno).text);
}

}  // namespace orbbuf
