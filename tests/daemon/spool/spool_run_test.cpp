// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <algorithm>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <utility>

#include "daemon/spool/spool.hpp"
#include "tests/daemon/spool/spool_fixture.hpp"

namespace orbbuf::test {
namespace {

using Number = std::pair<std::string, Sequence>;

/// A spool in a folder, with restarts, beside lists of what it must hold.
class ListedSpool {
 public:
  /// `has_restarts`: or frames are forgotten, which a restart would bring back.
  ListedSpool(SpoolSettings settings, unsigned seed, bool has_restarts)
      : settings_(std::move(settings)), random_(seed), has_restarts_(has_restarts) {
    restart();
  }

  void step() {
    switch (random_() % 64) {
      case 0:
        return has_restarts_ ? restart() : forget();
      case 1:
      case 2:
        return rewind();
      case 3:
      case 4:
        return has_restarts_ ? rewind() : forget();
      default:
        break;
    }
    const auto choice = random_() % 5;
    if (choice < 2) return add();
    if (choice < 4) return take();
    acknowledge(random_() % 5);
  }

  void check() {
    std::map<std::string, FrameRange> expected;
    for (const auto* const frames : {&handed_out_, &waiting_}) {
      for (const auto& [session, sequence] : *frames) expected[session].add(sequence);
    }
    (*spool_).wait_until([&] { return held() == expected; });
    const auto stats = (*spool_)->stats();
    EXPECT_EQ(stats.frames, handed_out_.size() + waiting_.size());
    EXPECT_EQ(stats.evicted + stats.not_spooled + stats.damaged, 0U);
  }

  void drain() {
    while (!waiting_.empty()) take();
    acknowledge(handed_out_.size());
    check();
  }

 private:
  std::map<std::string, FrameRange> held() {
    std::map<std::string, FrameRange> held;
    for (const auto& [session, frames, first] : (*spool_)->held()) {
      // The highest number is not said.
      FrameRange range{frames, first, first};
      for (const auto* const list : {&handed_out_, &waiting_}) {
        for (const auto& [id, sequence] : *list) {
          if (id == session) range.last = std::max(range.last, sequence);
        }
      }
      held[session] = range;
    }
    return held;
  }
  std::size_t bytes(Sequence sequence) const { return 1 + sequence * 104'729 % 150'000; }

  void restart() {
    spool_.reset();
    session_ = "session-" + std::to_string(++sessions_);
    next_sequence_ = 0;
    spool_ = std::make_unique<WatchedSpool>(settings_, session_);
    std::deque<Number> all = std::exchange(handed_out_, {});
    all.insert(all.end(), waiting_.begin(), waiting_.end());
    waiting_ = std::move(all);
  }
  void add() {
    (*spool_)->add(spool_frame(next_sequence_, bytes(next_sequence_)));
    waiting_.emplace_back(session_, next_sequence_++);
  }
  void take() {
    if (waiting_.empty()) return;
    const SpooledFrame spooled = spool_->next();
    const Number number(spooled.session_id, spooled.frame->sequence);
    ASSERT_EQ(number, waiting_.front());
    ASSERT_TRUE(is_same(*spooled.frame, *spool_frame(number.second, bytes(number.second))));
    handed_out_.push_back(number);
    waiting_.pop_front();
  }
  void acknowledge(std::size_t count) {
    count = std::min(count, handed_out_.size());
    (*spool_)->acknowledge(count);
    handed_out_.erase(handed_out_.begin(),
                      handed_out_.begin() + static_cast<std::ptrdiff_t>(count));
  }
  void rewind() {
    (*spool_)->rewind();
    waiting_.insert(waiting_.begin(), handed_out_.begin(), handed_out_.end());
    handed_out_.clear();
  }
  void forget() {
    if (next_sequence_ == 0) return;
    const Number number(session_, random_() % next_sequence_);
    const auto found = std::find(waiting_.begin(), waiting_.end(), number);
    if (found == waiting_.end()) return;
    (*spool_)->forget(number.second);
    waiting_.erase(found);
  }

  const SpoolSettings settings_;
  std::mt19937 random_;
  const bool has_restarts_;
  std::unique_ptr<WatchedSpool> spool_;
  std::string session_;
  int sessions_ = 0;
  Sequence next_sequence_ = 0;
  std::deque<Number> handed_out_;
  std::deque<Number> waiting_;
};

using SpoolRunTest = SpoolTest;

TEST_F(SpoolRunTest, DoesAsAListDoes) {
  for (unsigned seed = 0; seed < 4; ++seed) {
    SCOPED_TRACE(seed);
    ListedSpool spool({folder_ / std::to_string(seed), 256 << 20, 0}, seed, seed % 2 == 0);
    for (int step = 0; step < 1000; ++step) {
      spool.step();
      if (step % 25 == 0) spool.check();
      if (HasFatalFailure()) return;
    }
    spool.drain();
  }
}

}  // namespace
}  // namespace orbbuf::test
