// SPDX-License-Identifier: Apache-2.0
// Long random runs of FrameBuffer, over every policy, against a naive account and a server that
// really knows what it took.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/buffer/make_policy.hpp"
#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kCapacity = 6;
constexpr Sequence kThreadedFrames = 20'000;
using Sequences = std::vector<Sequence>;

std::unique_ptr<DropPolicy> make(std::string_view name) {
  BufferSettings settings;
  settings.policy = name;
  return make_policy(settings, random_features);
}

/// Passes over many frames: the camera has a frame every 10 ms, and the deadlines are short.
std::unique_ptr<SendPlanner> make_planner(std::string_view name) {
  if (name != "catch-up") return nullptr;
  return std::make_unique<SendPlanner>(
      PlanSettings{std::chrono::milliseconds(50), std::chrono::seconds(1)});
}

/// The server of one session and the connection to it. A broken connection loses what was written
/// but not yet taken.
struct Server {
  Sequences written;  // on the present connection, not taken yet
  Sequences taken;
  Sequence next = 0;

  void write(Sequence sequence) {
    ASSERT_GE(sequence, written.empty() ? next : written.back() + 1) << "repeated or out of order";
    written.push_back(sequence);
  }
  void take(std::size_t count) {
    for (; count > 0 && !written.empty(); --count) {
      taken.push_back(written.front());
      next = written.front() + 1;
      written.erase(written.begin());
    }
  }
};

/// Where each frame is, kept without any cleverness.
struct Account {
  Sequences waiting;
  Sequences in_flight;
  std::set<Sequence> returned;
  std::set<Sequence> delivered;
  Sequences unconfirmed;
  Sequences final_drops;
  wire::Stats counts;

  wire::Stats stats() const {
    wire::Stats stats = counts;
    stats.acknowledged = delivered.size();
    stats.waiting += waiting.size();
    stats.in_flight = in_flight.size();
    stats.dropped = final_drops.size() + unconfirmed.size() - stats.skipped - stats.failed;
    return stats;
  }
  void drop(Sequence victim) {
    std::erase(waiting, victim);
    (returned.erase(victim) ? unconfirmed : final_drops).push_back(victim);
  }
  void return_in_flight() {
    returned.insert(in_flight.begin(), in_flight.end());
    waiting.insert(waiting.begin(), in_flight.begin(), in_flight.end());
    in_flight.clear();
  }
  void resume(Sequence next) {
    for (const Sequence sequence : unconfirmed) {
      if (sequence >= next) final_drops.push_back(sequence);
      if (sequence < next) delivered.insert(sequence);
    }
    for (const Sequence sequence : returned) {
      if (sequence >= next) continue;
      delivered.insert(sequence);
      std::erase(waiting, sequence);
    }
    unconfirmed.clear();
    returned.clear();
  }
};

/// Lets another policy choose, checks what it is shown, and keeps the account.
struct Witness final : DropPolicy {
  Witness(std::unique_ptr<DropPolicy> policy, Account& account)
      : policy_(std::move(policy)), account_(account) {}

  bool prepare(const BufferView& view) override {
    check(view);
    return policy_->prepare(view);
  }
  std::size_t victim(const BufferView& view) override {
    check(view);
    const std::size_t choice = policy_->victim(view);
    account_.drop(view.waiting.at(choice)->sequence);
    return choice;
  }
  void check(const BufferView& view) const {
    EXPECT_EQ(sequences_of(view.waiting), account_.waiting);
    if (!account_.in_flight.empty()) {
      EXPECT_EQ(view.previous->sequence, account_.in_flight.back());
    } else if (!account_.delivered.empty()) {
      EXPECT_EQ(view.previous->sequence, *account_.delivered.rbegin());
    } else {
      EXPECT_FALSE(view.previous);
    }
  }

  const std::unique_ptr<DropPolicy> policy_;
  Account& account_;
};

class FrameBufferRunTest : public testing::TestWithParam<std::string_view> {
 protected:
  void capture() {
    buffer_.on_captured();
    ++account_.counts.captured;
    ++account_.counts.waiting;
  }
  void push_or_lose() {
    if (account_.counts.waiting == 0) return capture();
    --account_.counts.waiting;
    const Sequence sequence = entered_++;
    switch (random_() % 16) {
      case 0:
        ++account_.counts.skipped;
        account_.final_drops.push_back(sequence);
        return buffer_.on_lost({sequence, 0, DropReason::kBusy});
      case 1:
        ++account_.counts.failed;
        account_.final_drops.push_back(sequence);
        return buffer_.on_lost({sequence, 0, DropReason::kFailed});
      default:
        account_.waiting.push_back(sequence);
        return buffer_.push(make_frame_ptr(sequence));
    }
  }
  void take() {
    if (!is_connected_) return;
    now_ += std::chrono::milliseconds(random_() % 40);
    const FramePtr frame = buffer_.take({now_, static_cast<double>(random_() % 200)});
    ASSERT_EQ(frame == nullptr, account_.waiting.empty());
    if (!frame) return;
    while (is_planned_ && frame->sequence > account_.waiting.front()) {
      ++passed_over_;
      account_.drop(account_.waiting.front());
      ASSERT_FALSE(account_.waiting.empty());
    }
    ASSERT_EQ(frame->sequence, account_.waiting.front());
    account_.waiting.erase(account_.waiting.begin());
    account_.in_flight.push_back(frame->sequence);
    server_.write(frame->sequence);
  }
  void acknowledge() {
    if (!is_connected_) return;
    const Sequence next = server_.next - std::min<Sequence>(server_.next, random_() % 3);
    std::erase_if(account_.in_flight, [&](Sequence sequence) {
      return sequence < next && account_.delivered.insert(sequence).second;
    });
    buffer_.acknowledge(next);
  }
  void break_connection() {
    buffer_.return_in_flight();
    account_.return_in_flight();
    server_.written.clear();
    is_connected_ = false;
  }
  void connect() {
    if (is_connected_) return;
    buffer_.resume(server_.next);
    account_.resume(server_.next);
    is_connected_ = true;
  }
  void prepare() { buffer_.prepare(); }
  void collect() {
    const Sequences drops = sequences_of(collect_drops(buffer_));
    collected_.insert(collected_.end(), drops.begin(), drops.end());
    ASSERT_EQ(collected_, account_.final_drops);
  }
  void step() {
    const std::uint64_t choice = random_() % 64;
    if (choice < 8) return capture();
    if (choice < 24) return push_or_lose();
    if (choice < 36) return take();
    if (choice < 46) return server_.take(static_cast<std::size_t>(random_() % 3));
    if (choice < 54) return acknowledge();
    if (choice < 56) return break_connection();
    if (choice < 58) return connect();
    if (choice < 62) return prepare();
    collect();
  }
  void check() {
    const wire::Stats now = buffer_.stats();
    ASSERT_EQ(now, account_.stats());
    ASSERT_EQ(now.captured, now.skipped + now.failed + now.dropped + now.acknowledged +
                                now.waiting + now.in_flight);
  }

  std::mt19937_64 random_{1};
  Account account_;
  FrameBuffer buffer_{
      {kCapacity}, std::make_unique<Witness>(make(GetParam()), account_), make_planner(GetParam())};
  const bool is_planned_ = GetParam() == "catch-up";
  std::chrono::nanoseconds now_{0};
  std::size_t passed_over_ = 0;
  Server server_;
  Sequences collected_;
  Sequence entered_ = 0;
  bool is_connected_ = true;
};

INSTANTIATE_TEST_SUITE_P(Policies, FrameBufferRunTest, testing::ValuesIn(kPolicies),
                         [](const auto& test) { return test_name(std::string(test.param)); });

/// Each of 0 .. count - 1 is in exactly one of the two.
void expect_each_once(Sequences taken, const Sequences& dropped, Sequence count) {
  taken.insert(taken.end(), dropped.begin(), dropped.end());
  std::ranges::sort(taken);
  ASSERT_EQ(taken.size(), count);
  for (Sequence sequence = 0; sequence < count; ++sequence) {
    ASSERT_EQ(taken[static_cast<std::size_t>(sequence)], sequence);
  };
}

TEST_P(FrameBufferRunTest, AccountsForEveryFrameAfterEveryOperation) {
  for (int i = 0; i < 100'000 && !HasFailure(); ++i) {
    step();
    check();
  }
  while (account_.counts.waiting > 0) push_or_lose();
  collect();
  break_connection();
  buffer_.resume(server_.next);
  buffer_.give_up();
  const Sequences last = sequences_of(collect_drops(buffer_));
  collected_.insert(collected_.end(), last.begin(), last.end());
  expect_each_once(server_.taken, collected_, entered_);
  EXPECT_EQ(buffer_.stats().acknowledged, server_.taken.size());
  EXPECT_GT(server_.taken.size(), 1'000U);
  EXPECT_EQ(passed_over_ > 1'000U, is_planned_);
}

TEST_P(FrameBufferRunTest, LosesNothingBetweenTwoThreads) {
  FrameBuffer buffer({kCapacity}, make(GetParam()), make_planner(GetParam()));
  std::jthread worker([&](const std::stop_token& stop) {
    for (Sequence sequence = 0; sequence < kThreadedFrames; ++sequence) {
      if (sequence % 2 == 0) buffer.wait_for_room(stop);
      capture_and_push(buffer, sequence);
      if (sequence % 3 == 0) buffer.prepare();
    }
  });
  const auto limit = std::chrono::steady_clock::now() + std::chrono::minutes(4);
  for (bool is_done = false; !is_done;) {
    ASSERT_LT(std::chrono::steady_clock::now(), limit) << buffer.stats().captured << " captured";
    now_ += std::chrono::milliseconds(1);
    const FramePtr frame = buffer.take({now_, 100});
    if (frame) server_.write(frame->sequence);
    server_.take(static_cast<std::size_t>(random_() % 3));
    if (random_() % 2 == 0) buffer.acknowledge(server_.next);
    if (random_() % 64 == 0) {
      buffer.return_in_flight();
      server_.written.clear();
      std::this_thread::yield();
      buffer.resume(server_.next);
    }
    const wire::Stats now = buffer.stats();
    ASSERT_EQ(now.captured, now.dropped + now.acknowledged + now.waiting + now.in_flight);
    is_done = now.captured == kThreadedFrames && now.waiting + now.in_flight == 0;
  }
  worker.join();
  expect_each_once(server_.taken, sequences_of(collect_drops(buffer)), kThreadedFrames);
}

}  // namespace
}  // namespace orbbuf
