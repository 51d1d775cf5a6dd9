// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/recording_parts.hpp"

#include <algorithm>
#include <optional>
#include <system_error>
#include <vector>

#include "common/log.hpp"
#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;

std::vector<RecordingParts::Key> sessions_in(const fs::path& path) {
  std::vector<RecordingParts::Key> sessions;
  std::error_code failed;  // what cannot be listed is not there
  for (fs::directory_iterator robot(path, failed); !failed && robot != fs::directory_iterator();
       robot.increment(failed)) {
    const std::string robot_id = robot->path().filename().string();
    if (!wire::is_valid_id(robot_id)) continue;
    std::error_code none;
    for (fs::directory_iterator session(robot->path(), none);
         !none && session != fs::directory_iterator(); session.increment(none)) {
      const std::string session_id = session->path().filename().string();
      if (wire::is_valid_id(session_id)) sessions.emplace_back(robot_id, session_id);
    }
  }
  return sessions;
}

}  // namespace

RecordingParts::RecordingParts(asio::io_context& main, asio::thread_pool& pool,
                               SessionStores& stores, Options options)
    : main_(main), pool_(pool), stores_(stores), options_(std::move(options)), timer_(main) {}

void RecordingParts::start() {
  stores_.watch([this](SessionStores::Event event, const std::string& robot_id,
                       const std::string& session_id) {
    on_event(event, {robot_id, session_id});
  });
  run_in_pool(
      main_, pool_, [path = options_.path] { return sessions_in(path); },
      [this](std::vector<Key> sessions) { look_at(std::move(sessions)); });
}

/// One after the other.
void RecordingParts::look_at(std::vector<Key> sessions) {
  if (sessions.empty() || stopped_) return;
  const Key session = std::move(sessions.back());
  sessions.pop_back();
  run_in_pool(
      main_, pool_,
      [folder = options_.path / session.first / session.second] {
        if (const auto error = mcap::remove_images(folder)) log_warn("{}", error->text);
        return mcap::lacks_part(folder);
      },
      [this, session, sessions = std::move(sessions)](bool lacks_part) mutable {
        if (lacks_part) finish(session);
        look_at(std::move(sessions));
      });
}

void RecordingParts::on_event(SessionStores::Event event, const Key& session) {
  using enum SessionStores::Event;
  switch (event) {
    case kOpened:
      live_.insert(session);
      due_.emplace(session, Clock::now() + kMarkAfter);
      return schedule();
    case kLate:
      if (live_.contains(session)) return;
      due_.emplace(session,
                   options_.split.count() > 0 ? next_part() : Clock::now() + kLatePatience);
      return schedule();
    case kClosed:
      live_.erase(session);
      return finish(session);
  }
}

RecordingParts::Clock::time_point RecordingParts::next_part() const {
  return options_.split.count() > 0 ? Clock::now() + options_.split : Clock::time_point::max();
}

void RecordingParts::finish(const Key& session) {
  due_[session] = Clock::now();
  schedule();
}

void RecordingParts::stop(std::function<void()> stopped) {
  stopped_ = std::move(stopped);
  for (auto& [session, due] : due_) due = Clock::now();
  schedule();
}

void RecordingParts::schedule() {
  if (is_busy_) return;
  const auto next = std::ranges::min_element(due_, {}, [](const auto& one) { return one.second; });
  if (next == due_.end()) {
    timer_.cancel();
    if (!stopped_) return;
    stores_.stop();  // those that the last parts have opened
    return std::exchange(stopped_, [] {})();
  }
  if (next->second <= Clock::now()) return make(Key(next->first));
  timer_.expires_at(next->second);
  timer_.async_wait([this](const boost::system::error_code& failed) {
    if (!failed) schedule();
  });
}

void RecordingParts::make(const Key& session) {
  is_busy_ = true;
  due_.erase(session);
  const bool is_live = live_.contains(session);
  const auto maker = std::make_shared<std::optional<mcap::PartMaker>>();
  stores_.use(session.first, session.second)
      ->run(
          [is_live, maker](SessionStore& store) -> Result<bool> {
            if (store.is_new()) return false;
            if (is_live && !store.summary().part) {
              if (auto error = store.note_part({})) return std::move(*error);
              return true;
            }
            const auto last = store.summary().part.value_or(RecordedPart{});
            const RecordedPart part{last.number + 1, last.to, store.written()};
            maker->emplace(store.folder(), store.summary(), part);
            return true;
          },
          [this, session, maker](const Result<bool>& has_frames) {
            if (!has_frames) return fail(session, has_frames.error());
            if (!stopped_ && live_.contains(session)) {
              due_.emplace(session, has_frames.value() ? next_part() : Clock::now() + kMarkAfter);
            }
            maker->has_value() ? step(session, maker) : go_on();
          });
}

void RecordingParts::step(const Key& session, const Maker& maker) {
  run_in_pool(
      main_, pool_, [maker] { return (*maker)->go_on(); },
      [this, session, maker](const Result<bool>& is_over) {
        if (!is_over) return fail(session, is_over.error());
        if (!is_over.value()) return step(session, maker);
        (*maker)->is_empty() ? go_on() : note(session, maker);
      });
}

void RecordingParts::note(const Key& session, const Maker& maker) {
  RecordedPart part = (*maker)->part();
  part.is_only_copy = options_.are_only_copies;
  stores_.use(session.first, session.second)
      ->run(
          [part](SessionStore& store) -> Result<bool> {
            if (auto error = store.note_part(part)) return std::move(*error);
            return true;
          },
          [this, session, part](const Result<bool>& is_noted) {
            if (!is_noted) return fail(session, is_noted.error());
            part.is_only_copy ? remove(session, part) : go_on();
          });
}

void RecordingParts::remove(const Key& session, const RecordedPart& part) {
  run_in_pool(
      main_, pool_,
      [folder = options_.path / session.first / session.second, part] {
        return mcap::remove_images(folder, part);
      },
      [this](const std::optional<Error>& error) {
        if (error) log_warn("{}", error->text);
        go_on();
      });
}

void RecordingParts::fail(const Key& session, const Error& error) {
  if (failures_.lets_through()) {
    log_error("{} {}: not recorded: {}", session.first, session.second, error.text);
  }
  if (!stopped_) due_[session] = Clock::now() + kRetry;
  go_on();
}

void RecordingParts::go_on() {
  is_busy_ = false;
  schedule();
}

}  // namespace orbbuf
