// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/position_recorder.hpp"

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "common/log.hpp"

namespace orbbuf::fleet {

PositionRecorder::PositionRecorder(boost::asio::io_context& main, KeyStore& store,
                                   std::chrono::milliseconds interval)
    : store_(store), interval_(interval), timer_(main) {}

void PositionRecorder::async_record(const Claim& claim, const wire::Position& position,
                                    Recorded recorded) {
  if (is_stopped_) return;
  waiting_.push_back({claim, position, std::move(recorded)});
  schedule();
}

void PositionRecorder::hurry() {
  if (waiting_.empty()) return;
  is_hurried_ = true;
  schedule();
}

void PositionRecorder::stop() {
  is_stopped_ = true;
  timer_.cancel();
  waiting_.clear();
}

void PositionRecorder::schedule() {
  if (!sent_.empty() || waiting_.empty() || is_stopped_) return;
  timer_.expires_at(std::exchange(is_hurried_, false) ? Clock::time_point{} : next_);
  timer_.async_wait([this](const boost::system::error_code& aborted) {
    if (!aborted && sent_.empty() && !is_stopped_) begin();
  });
}

void PositionRecorder::begin() {
  begun_ = Clock::now();
  next_ = begun_ + interval_;
  const auto count = std::min(waiting_.size(), KeyStore::kMostTxns);
  const auto end = waiting_.begin() + static_cast<std::ptrdiff_t>(count);
  std::move(waiting_.begin(), end, std::back_inserter(sent_));
  waiting_.erase(waiting_.begin(), end);
  if (!waiting_.empty()) is_hurried_ = true;  // more than a request takes
  std::vector<KeyTxn> txns;
  for (const auto& [claim, position, recorded] : sent_) {
    const std::string owner = claim.session.owner_key();
    const std::string key = claim.session.position_key();
    txns.push_back({{{owner, 0, claim.owner}, {key, *claim.revision}},
                    {{key, to_text(position)}},
                    {},
                    {owner, key}});
  }
  store_.async_txns(std::move(txns), [this](const auto& answer) { on_answer(answer); });
}

void PositionRecorder::on_answer(const Result<std::vector<KeyTxnOutcome>>& answer) {
  if (is_stopped_) return;
  auto sent = std::exchange(sent_, {});
  if (!answer) {
    if (!std::exchange(is_failing_, true)) {
      log_error("fleet: nothing is acknowledged until it is recorded: {}", answer.error().text);
    }
    // It may have been recorded; to record it again is harmless.
    waiting_.insert(waiting_.begin(), std::make_move_iterator(sent.begin()),
                    std::make_move_iterator(sent.end()));
    return schedule();
  }
  if (std::exchange(is_failing_, false)) log_info("fleet: etcd answers again");
  ++requests_;
  time_spent_ += Clock::now() - begun_;
  for (std::size_t i = 0; i < sent.size(); ++i) {
    if (const auto is_ours = decide(sent[i], answer.value()[i])) {
      ++(*is_ours ? records_ : conflicts_);
      sent[i].recorded(*is_ours);
    } else {
      waiting_.push_front(std::move(sent[i]));
      is_hurried_ = true;
    }
  }
  schedule();
}

/// Whether the position is recorded, or never will be; nothing: it is not known yet.
std::optional<bool> PositionRecorder::decide(const Job& job, const KeyTxnOutcome& outcome) {
  std::int64_t& revision = *job.claim.revision;
  if (outcome.is_done) {
    revision = outcome.revision;
    return true;
  }
  const KeyValue* const owner = outcome.find(job.claim.session.owner_key());
  if (owner == nullptr || owner->value != job.claim.owner) return false;
  const KeyValue* const position = outcome.find(job.claim.session.position_key());
  revision = position != nullptr ? position->mod_revision : 0;
  const bool is_there = position != nullptr && position->value == to_text(job.position);
  return is_there ? std::optional(true) : std::nullopt;
}

}  // namespace orbbuf::fleet
