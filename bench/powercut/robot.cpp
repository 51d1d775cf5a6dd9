// SPDX-License-Identifier: Apache-2.0
#include "bench/powercut/robot.hpp"

#include <poll.h>

#include <algorithm>
#include <iterator>
#include <thread>

namespace orbbuf::powercut {
namespace {

constexpr Sequence kWindow = 16;
/// What is late comes so many steps later.
constexpr Sequence kLateAfter = 20;
constexpr Sequence kAccountEvery = 50;

}  // namespace

wire::Position Robot::acknowledged_by(Clock::time_point time) const {
  const auto later = std::ranges::find_if(acks_, [&](const Ack& ack) { return ack.time > time; });
  return later == acks_.begin() ? wire::Position{} : std::prev(later)->position;
}

void Robot::run(std::uint16_t port, const std::atomic<bool>& has_ended) {
  const test::RobotClient link(port);
  if (!hello(link)) return;
  std::uint64_t lates = 0;
  for (Sequence step = 0; !has_ended; ++step) {
    end_ = step + 1;
    send(link, step, {});
    if (step >= kLateAfter) {
      for (const auto& late : content_.lates(step - kLateAfter)) send(link, late, lates++);
    }
    if (step % kAccountEvery == 0) send_account(link, step / kAccountEvery, true);
    const Sequence next = acks_.empty() ? 0 : acks_.back().position[wire::kFrames];
    if (!read_acks(link, step >= next + kWindow ? 200 : 0)) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(4));
  }
}

std::optional<wire::Position> Robot::finish(std::uint16_t port) {
  const test::RobotClient link(port);
  const auto welcome = hello(link);
  if (!welcome) return std::nullopt;
  wire::Position last;
  for (Sequence step = 0; step < end_; ++step) {
    send(link, step, *welcome);
    if (!Content::is_dropped(step)) last[wire::kFrames] = step + 1;
    for (const wire::Items& items : content_.items(step)) {
      if (Content::are_late(items, step)) continue;
      last[items.stream] = items.first + Content::items_a_step(items.stream);
    }
  }
  const std::uint64_t acknowledged = acknowledged_by(Clock::now())[wire::kLate];
  std::uint64_t lates = 0;
  for (Sequence step = 0; step < end_; ++step) {
    for (const auto& late : content_.lates(step)) {
      if (lates++ >= acknowledged) send(link, late, lates - 1 - acknowledged);
    }
  }
  send_account(link, 0, false);
  link.send(wire::encode(wire::Bye{last}));
  while (link.ack()) {  // until bye
  }
  return welcome;
}

std::optional<wire::Position> Robot::hello(const test::RobotClient& link) const {
  wire::Hello hello;
  hello.robot_id = name();
  hello.session_id = session_;
  hello.software = "powercut";
  hello.streams = content_.streams();
  link.send(wire::encode(hello));
  return link.welcome();
}

void Robot::send(const test::RobotClient& link, Sequence step, const wire::Position& from) const {
  for (const wire::Items& items : content_.items(step)) {
    if (items.first < from[items.stream] || Content::are_late(items, step)) continue;
    link.send(wire::encode(items));
  }
  if (!Content::is_dropped(step) && step >= from[wire::kFrames]) {
    link.send_frame(content_.live(step));
  }
}

void Robot::send(const test::RobotClient& link, const Content::Late& late,
                 std::uint64_t number) const {
  if (late.items) return link.send_late(number, wire::encode_late_record(session_, *late.items));
  link.send_late(number, wire::encode_late_record(session_, content_.whole(late.step)));
}

void Robot::send_account(const test::RobotClient& link, std::uint64_t number, bool is_held) const {
  wire::Account account;
  account.session_id = session_;
  account.captured = end_;
  account.held = is_held ? 1 : 0;
  for (const wire::StreamDeclaration& stream : content_.streams()) {
    account.streams.push_back({stream, end_ * Content::items_a_step(stream.id), account.held});
  }
  link.send_account(number, account);
}

bool Robot::read_acks(const test::RobotClient& link, int milliseconds) {
  pollfd events{link.fd(), POLLIN, 0};
  while (::poll(&events, 1, milliseconds) > 0) {
    const auto position = link.ack();
    if (!position) return false;
    acks_.push_back({Clock::now(), *position});
    milliseconds = 0;
  }
  return true;
}

}  // namespace orbbuf::powercut
