// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/earlier_sessions.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace orbbuf {

EarlierSessions::EarlierSessions(boost::asio::io_context& io, ServerLink& link)
    : link_(link), patience_(io) {}

void EarlierSessions::start(const wire::Hello& hello, std::vector<EarlierSession> sessions,
                            std::function<void()> done) {
  hello_ = hello;
  hello_.calibration.clear();  // the server has the session's own
  sessions_ = std::move(sessions);
  std::erase_if(sessions_, [&](const EarlierSession& earlier) {
    if (earlier.state.robot_id != hello.robot_id) return true;
    const bool lacks_bye = earlier.state.stage == SessionState::Stage::kEnded;
    if (lacks_bye || !describe(earlier).empty()) return false;
    settle(earlier);
    return true;
  });
  std::reverse(sessions_.begin(), sessions_.end());
  if (sessions_.empty()) return;
  done_ = std::move(done);
  begin_session();
}

void EarlierSessions::stop() {
  patience_.cancel();
  done_ = nullptr;
}

void EarlierSessions::begin_session() {
  records_.clear();
  is_collected_ = false;
  hello_.session_id = session().session_id;
  link_.switch_to(hello_, static_cast<ServerLink::Owner&>(*this));
}

void EarlierSessions::on_connected(const wire::Position& position) {
  is_bye_sent_ = false;
  if (!is_collected_) {
    patience_.expires_after(kPatience);
    patience_.async_wait([this](const boost::system::error_code& error) {
      if (!error && is_active()) leave("the server does not acknowledge it");
    });
    const auto& confirmed = session().state.confirmed;
    if (position == wire::Position{} && confirmed != wire::Position{}) {
      settle(session());
      return leave("the server does not have the session any more");
    }
    collect(position);
  }
  sent_ = static_cast<std::size_t>(std::min<std::uint64_t>(position.next_drop, records_.size()));
  if (is_told(position)) complete();
}

/// Frames below the server's position were received or have a drop record; the others have one, or
/// never will. A record that the server has and the robot lost with its power is the server's.
void EarlierSessions::collect(const wire::Position& position) {
  is_collected_ = true;
  records_ = session().records;
  std::erase_if(records_, [&](const DropRecord& record) {  // of what the server may have
    return record.reason == DropReason::kUnknown && record.sequence < position.next_sequence;
  });
  if (position.next_drop > records_.size()) return;
  const SessionState& state = session().state;
  std::vector<Sequence> named;
  for (const DropRecord& record : records_) named.push_back(record.sequence);
  std::sort(named.begin(), named.end());
  const std::size_t most = records_.size() + kMostUnknown;
  for (Sequence next = position.next_sequence; next < state.captured && records_.size() < most;
       ++next) {
    if (std::binary_search(named.begin(), named.end(), next)) continue;
    const bool was_confirmed = next < state.confirmed.next_sequence;
    records_.push_back({next, state.last_capture_time_ns,
                        was_confirmed ? DropReason::kLost : DropReason::kUnknown});
  }
}

bool EarlierSessions::is_told(const wire::Position& position) const {
  return session().state.stage == SessionState::Stage::kOpen &&
         position.next_drop >= records_.size();
}

void EarlierSessions::on_writable() {
  if (sent_ < records_.size()) {
    const std::size_t count = std::min(records_.size() - sent_, wire::kMaxDropsPerMessage);
    const auto first = records_.begin() + static_cast<std::ptrdiff_t>(sent_);
    const auto number = std::exchange(sent_, sent_ + count);
    link_.write(
        wire::encode(wire::Dropped{number, {first, first + static_cast<std::ptrdiff_t>(count)}}));
  } else if (session().state.stage == SessionState::Stage::kEnded && !is_bye_sent_) {
    is_bye_sent_ = true;
    link_.write(wire::encode(wire::Bye{{session().state.captured, records_.size()}}));
  }
}

void EarlierSessions::on_ack(const wire::Ack& ack) {
  if (is_told(ack.position)) complete();
}

void EarlierSessions::on_bye(const wire::Position& /*position*/) {
  if (is_bye_sent_) complete();
}

void EarlierSessions::complete() {
  const auto is_ours = [](const DropRecord& record) {
    return record.reason == DropReason::kUnknown || record.reason == DropReason::kLost;
  };
  spdlog::info("session {}: the server has its {} drop records now, {} of them unknown or lost",
               session().session_id, records_.size(),
               std::count_if(records_.begin(), records_.end(), is_ours));
  settle(session());
  go_on();
}

void EarlierSessions::leave(const std::string& why) {
  spdlog::warn("session {}: the server's record stays incomplete: {}", session().session_id, why);
  go_on();
}

void EarlierSessions::go_on() {
  patience_.cancel();
  sessions_.pop_back();
  if (!sessions_.empty()) return begin_session();
  std::exchange(done_, nullptr)();
}

}  // namespace orbbuf
