// SPDX-License-Identifier: Apache-2.0
#include "server/retention/retention.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <map>
#include <ratio>
#include <system_error>
#include <utility>

#include "common/log.hpp"
#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using std::chrono::steady_clock;
using std::chrono::system_clock;

constexpr std::chrono::milliseconds kStep{4};
constexpr std::chrono::milliseconds kPause{20};  // after each step

}  // namespace

Result<bool> remove_folder(const fs::path& folder, std::chrono::steady_clock::time_point deadline) {
  std::error_code failed;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    const fs::path& path = entry->path();
    std::error_code ignored;  // then unlink() says why
    if (fs::is_directory(entry->symlink_status(ignored))) {
      auto is_gone = remove_folder(path, deadline);
      if (!is_gone || !is_gone.value()) return is_gone;
    } else if (::unlink(path.c_str()) != 0 && errno != ENOENT) {
      return system_error("remove " + path.string(), errno);
    }
    if (std::chrono::steady_clock::now() >= deadline) return false;
  }
  if (failed && failed != std::errc::no_such_file_or_directory) {
    return system_error("read " + folder.string(), failed.value());
  }
  if (::rmdir(folder.c_str()) != 0 && errno != ENOENT) {
    return system_error("remove " + folder.string(), errno);
  }
  return true;
}

Retention::Retention(asio::io_context& main, asio::thread_pool& pool, Options options,
                     IsOpen is_open)
    : main_(main),
      pool_(pool),
      options_(std::move(options)),
      is_open_(std::move(is_open)),
      timer_(main),
      survey_(options_.path) {}

void Retention::wake() {
  if (is_stopped_ || !std::exchange(is_idle_, false)) return;
  timer_.cancel();
  survey(true);
}

void Retention::stop() {
  is_stopped_ = true;
  timer_.cancel();
}

/// Runs `then` on `main` after a pause, unless it is all over by then.
void Retention::pause_then(std::chrono::nanoseconds pause, std::function<void()> then) {
  if (is_stopped_) return;
  timer_.expires_after(pause);
  timer_.async_wait([self = shared_from_this(), then = std::move(then)](const auto& failed) {
    if (!failed && !self->is_stopped_) then();
  });
}

/// One step of a pass, and all that follow.
void Retention::survey(bool is_new) {
  run_in_pool(
      main_, pool_,
      [this, is_new] {
        if (is_new) survey_.begin();
        return survey_.go_on(steady_clock::now() + kStep);
      },
      [this, self = shared_from_this()](bool is_over) {
        if (is_over) return on_surveyed();
        pause_then(kPause, [this] { survey(false); });
      });
}

/// The quota, without the age while the clock is not to be trusted.
Quota Retention::quota_in_force() {
  const auto sessions = survey_.sessions();
  if (options_.quota.age.count() == 0 || sessions.empty()) return options_.quota;
  const SystemClockReading now = options_.read_clock();
  const auto newest = std::ranges::max_element(sessions, {}, &KeptSession::last_write);
  const bool was_trusted =
      std::exchange(is_clock_trusted_, clock_trust_.trusts(now, newest->last_write));
  if (is_clock_trusted_) return options_.quota;
  if (was_trusted) {
    const std::chrono::duration<double, std::ratio<3600>> ahead = now.wall - newest->last_write;
    log_warn(
        "{}: the clock may be wrong: it was set, or it is {:.1f} h ahead of the newest recording, "
        "and "
        "it is not synchronised; files.keep_time removes nothing until it is, or for {} h",
        options_.path.string(), ahead.count(), ClockTrust::kQuarantine.count());
  }
  Quota by_size = options_.quota;
  by_size.age = {};
  return by_size;
}

void Retention::on_surveyed() {
  const Quota quota = quota_in_force();
  std::map<std::string, std::vector<KeptSession>> robots;
  for (KeptSession& session : survey_.sessions()) {
    robots[session.robot_id].push_back(std::move(session));
  }
  for (const auto& [robot, sessions] : robots) {
    const auto newest = std::ranges::max_element(sessions, {}, &KeptSession::last_write);
    const auto may_go = [&](const KeptSession& session) {
      return is_finished(session, session.session_id == newest->session_id);
    };
    const auto going = over_quota(sessions, quota, system_clock::now(), may_go);
    going_.insert(going_.end(), going.begin(), going.end());
  }
  const auto& left_behind = survey_.set_aside_folders();
  aside_.assign(left_behind.begin(), left_behind.end());
  remove_next();
}

bool Retention::is_finished(const KeptSession& session, bool is_newest) const {
  if (is_open_(session.robot_id, session.session_id)) return false;
  return !is_newest || system_clock::now() - session.last_write > options_.session_timeout;
}

/// What is over the quota, one after the other, and then a while of nothing.
void Retention::remove_next() {
  if (is_stopped_) return;
  while (aside_.empty() && !going_.empty()) {
    set_aside(going_.front());
    going_.pop_front();
  }
  if (aside_.empty()) {
    is_idle_ = true;
    return pause_then(options_.interval, [this] { wake(); });
  }
  const fs::path folder = std::move(aside_.front());
  aside_.pop_front();
  remove(folder);
}

void Retention::set_aside(const KeptSession& session) {
  if (is_open_(session.robot_id, session.session_id)) return;  // by now
  const fs::path robot = options_.path / session.robot_id;
  const fs::path folder = robot / session.session_id;
  fs::path aside = set_aside_folder(robot, session.session_id);
  if (std::rename(folder.c_str(), aside.c_str()) != 0) {
    return fail(system_error("remove " + folder.string(), errno));
  }
  aside_.push_back(std::move(aside));
  constexpr double kMiB = 1024.0 * 1024.0;
  const std::chrono::duration<double, std::ratio<3600>> age =
      system_clock::now() - session.last_write;
  const bool is_too_old =
      is_clock_trusted_ && options_.quota.age.count() > 0 && age > options_.quota.age;
  log_info("{} {}: removed, {:.1f} MiB, last written to {:.1f} h ago: over {}", session.robot_id,
           session.session_id, static_cast<double>(session.bytes) / kMiB, age.count(),
           is_too_old ? "files.keep_time" : "files.keep_size");
}

/// Each pass tries again; the log has it once.
void Retention::fail(const Error& error) {
  if (failures_.insert(error.text).second) log_error("{}", error.text);
}

/// One step, and all that follow.
void Retention::remove(const fs::path& folder) {
  run_in_pool(
      main_, pool_, [folder] { return remove_folder(folder, steady_clock::now() + kStep); },
      [this, self = shared_from_this(), folder](const Result<bool>& is_gone) {
        if (is_gone && !is_gone.value()) {
          return pause_then(kPause, [this, folder] { remove(folder); });
        }
        if (!is_gone) fail(is_gone.error());
        pause_then(kPause, [this] { remove_next(); });
      });
}

}  // namespace orbbuf
