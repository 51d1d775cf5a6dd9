// SPDX-License-Identifier: Apache-2.0
#include "server/link/late_arrivals.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <system_error>
#include <utility>

#include "server/recording/file_io.hpp"
#include "server/recording/late_merge.hpp"
#include "server/recording/session_names.hpp"
#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using boost::system::error_code;

constexpr std::chrono::seconds kRetry{1};

std::int64_t now_ns() {
  return std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
}

const wire::SpooledSession* find(const std::vector<wire::SpooledSession>& sessions,
                                 const std::string& session_id) {
  const auto found = std::ranges::find(sessions, session_id, &wire::SpooledSession::session_id);
  return found == sessions.end() ? nullptr : &*found;
}

}  // namespace

LateArrivals::LateArrivals(asio::io_context& main, asio::thread_pool& pool, fs::path folder,
                           GroupCommit* commit, IsOpen is_open)
    : main_(main),
      pool_(pool),
      folder_(std::move(folder)),
      commit_(commit),
      is_open_(std::move(is_open)) {}

LateArrivals::RobotPtr LateArrivals::robot(const std::string& robot_id) {
  RobotPtr& robot = robots_[robot_id];
  if (!robot) robot = std::make_shared<Robot>(pool_);
  return robot;
}

std::shared_ptr<LateFiles> LateArrivals::files(const std::string& robot_id, const RobotPtr& robot,
                                               const std::string& session_id) {
  std::shared_ptr<LateFiles>& files = robot->files[session_id];
  if (!files) files = std::make_shared<LateFiles>(folder_ / robot_id / session_id);
  return files;
}

void LateArrivals::write(const std::string& robot_id, wire::LateFrame late,
                         std::weak_ptr<void> waiter, Kept kept) {
  try_to_write(robot_id, std::make_shared<const wire::LateFrame>(std::move(late)),
               std::move(waiter), std::move(kept));
}

void LateArrivals::try_to_write(const std::string& robot_id,
                                const std::shared_ptr<const wire::LateFrame>& late,
                                std::weak_ptr<void> waiter, Kept kept) {
  const RobotPtr robot = this->robot(robot_id);
  run_in_pool(
      main_, robot->strand,
      [files = files(robot_id, robot, late->session_id), late] {
        return files->write(late->frame, now_ns());
      },
      [this, robot_id, robot, late, waiter = std::move(waiter),
       kept = std::move(kept)](const Result<bool>& written) mutable {
        if (written) {
          robot->is_failing = false;
          return commit(std::move(waiter), std::move(kept), written.value());
        }
        if (!std::exchange(robot->is_failing, true)) {
          spdlog::error("{}: late frames paused: {}", robot_id, written.error().text);
        }
        const auto timer = std::make_shared<asio::steady_timer>(main_, kRetry);
        timer->async_wait([this, timer, robot_id, late, waiter = std::move(waiter),
                           kept = std::move(kept)](const error_code& failed) mutable {
          if (failed || waiter.expired()) return;
          try_to_write(robot_id, late, std::move(waiter), std::move(kept));
        });
      });
}

void LateArrivals::commit(std::weak_ptr<void> waiter, Kept kept, bool is_new) {
  if (commit_ == nullptr) {
    if (!waiter.expired()) kept(is_new);
    return;
  }
  commit_->async_commit([this, waiter = std::move(waiter), kept = std::move(kept),
                         is_new](const std::optional<Error>& error) {
    has_commit_failed_ = has_commit_failed_ || error.has_value();
    if (!error && !waiter.expired()) kept(is_new);
  });
}

void LateArrivals::on_spool(const std::string& robot_id, const wire::Spool& spool) {
  const RobotPtr robot = this->robot(robot_id);
  const bool is_first = !robot->said;
  const auto before = robot->said.value_or(wire::Spool{}).sessions;
  robot->said = spool;
  const bool has_one_gone = std::ranges::any_of(before, [&](const wire::SpooledSession& session) {
    return find(spool.sessions, session.session_id) == nullptr;
  });
  const auto now = std::chrono::steady_clock::now();
  if (is_first || has_one_gone || now >= robot->noted_at + kNoteInterval) {
    robot->noted_at = now;
    note(robot_id, robot);
  }
  if (is_first || has_one_gone) look_for_complete(robot_id, robot);
}

/// In the folders of the sessions for which that has changed.
void LateArrivals::note(const std::string& robot_id, const RobotPtr& robot) {
  const auto& now = robot->said->sessions;
  for (const wire::SpooledSession& session : now) {
    const auto* const noted = find(robot->noted, session.session_id);
    if (noted == nullptr || *noted != session) note(robot_id, robot, session.session_id, session);
  }
  for (const wire::SpooledSession& noted : robot->noted) {
    if (find(now, noted.session_id) == nullptr) note(robot_id, robot, noted.session_id, {});
  }
  robot->noted = now;
}

void LateArrivals::note(const std::string& robot_id, const RobotPtr& robot,
                        const std::string& session_id, const wire::SpooledSession& session) {
  asio::post(robot->strand, [files = files(robot_id, robot, session_id),
                             holds = RobotHolds{session.frames, session.first, now_ns()}] {
    if (const auto error = files->note(holds)) spdlog::warn("not noted: {}", error->text);
  });
}

void LateArrivals::on_closed(const std::string& robot_id, const std::string& session_id) {
  const auto known = robots_.find(robot_id);
  if (known == robots_.end() || !known->second->said) return;
  if (find(known->second->said->sessions, session_id) != nullptr) return;
  look_for_complete(robot_id, known->second);
}

bool LateArrivals::is_expected(const std::string& robot_id, const std::string& session_id) const {
  const auto known = robots_.find(robot_id);
  return known != robots_.end() && known->second->said &&
         find(known->second->said->sessions, session_id) != nullptr;
}

bool LateArrivals::is_merging(const std::string& robot_id, const std::string& session_id) const {
  const auto known = robots_.find(robot_id);
  return known != robots_.end() && known->second->merging.contains(session_id);
}

/// Whether frames of that session may still be written.
bool LateArrivals::can_come(const std::string& robot_id, const Robot& robot,
                            const std::string& session_id) const {
  return is_open_(robot_id, session_id) || !robot.said ||
         find(robot.said->sessions, session_id) != nullptr;
}

void LateArrivals::look_for_complete(const std::string& robot_id, const RobotPtr& robot) {
  if (has_commit_failed_ || *is_stopping_) return;
  run_in_pool(
      main_, robot->strand, [folder = folder_ / robot_id] { return find_leftovers(folder); },
      [this, robot_id, robot](const std::vector<Leftover>& leftovers) {
        for (const Leftover& leftover : leftovers) {
          if (can_come(robot_id, *robot, leftover.session_id)) continue;
          if (robot->merging.contains(leftover.session_id)) continue;
          merge(robot_id, robot, leftover);
        }
      });
}

/// Sessions with frames that are not merged, or of which the robot once held some.
std::vector<LateArrivals::Leftover> LateArrivals::find_leftovers(const fs::path& folder) {
  std::vector<Leftover> leftovers;
  std::error_code failed;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    const fs::path& path = entry->path();
    std::string session_id = path.filename().string();
    if (!wire::is_valid_id(session_id)) continue;
    std::error_code ignored;  // then it is not there
    const bool is_unmerged = fs::exists(path / session_names::kLate, ignored);
    const auto text = read_text(path / session_names::kSpool);
    const auto holds = text ? holds_from_csv(text.value()) : std::nullopt;
    if (is_unmerged || (holds && holds->held > 0)) {
      leftovers.push_back({std::move(session_id), is_unmerged});
    }
  }
  return leftovers;
}

void LateArrivals::merge(const std::string& robot_id, const RobotPtr& robot,
                         const Leftover& leftover) {
  const std::string& session_id = leftover.session_id;
  note(robot_id, robot, session_id, {});
  robot->files.erase(session_id);
  if (!leftover.is_unmerged) return;
  robot->merging.insert(session_id);
  run_in_pool(
      main_, robot->strand,
      [folder = folder_ / robot_id / session_id] { return merge_late(folder); },
      [robot_id, robot, session_id](const Result<MergedLate>& merged) {
        robot->merging.erase(session_id);
        if (!merged) {
          spdlog::error("{} {}: late frames are not merged: {}", robot_id, session_id,
                        merged.error().text);
          return;
        }
        if (!merged.value().is_complete) return;
        spdlog::info("{} {}: {} late frames have completed the session", robot_id, session_id,
                     merged.value().frames);
      });
}

}  // namespace orbbuf
