// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/fleet/key_store.hpp"

namespace orbbuf::test {

/// The keys themselves, which several servers share.
struct FakeKeys {
  std::map<std::string, KeyValue> keys;
  std::map<std::string, std::int64_t> leases;  // of the keys; 0: none
  std::int64_t revision = 1;

  KeyTxnOutcome run(const KeyTxn& txn) {
    KeyTxnOutcome outcome;
    outcome.is_done = true;
    for (const auto& [key, mod_revision, value] : txn.compare) {
      const auto found = keys.find(key);
      if (value) {
        outcome.is_done = outcome.is_done && found != keys.end() && found->second.value == *value;
        continue;
      }
      const std::int64_t is = found == keys.end() ? 0 : found->second.mod_revision;
      outcome.is_done = outcome.is_done && is == mod_revision;
    }
    if (outcome.is_done && !txn.puts.empty()) {
      ++revision;
      for (const auto& [key, value, lease] : txn.puts) {
        keys[key] = {key, value, revision};
        leases[key] = lease;
      }
    }
    outcome.revision = revision;
    auto reads = txn.reads;
    if (!outcome.is_done) {
      reads.insert(reads.end(), txn.reads_if_refused.begin(), txn.reads_if_refused.end());
    }
    for (const std::string& key : reads) {
      if (const auto found = keys.find(key); found != keys.end()) {
        outcome.found.push_back(found->second);
      }
    }
    return outcome;
  }
};

/// One server's way to the keys, each half of which a test walks: a request is sent, is carried
/// out (arrive()), and its answer comes back (deliver()); a server that is paused in between finds
/// the world changed. fail() loses the answer.
class FakeKeyStore final : public KeyStore {
 public:
  explicit FakeKeyStore(FakeKeys& keys) : keys_(keys) {}

  void async_txns(std::vector<KeyTxn> txns, Done<std::vector<KeyTxnOutcome>> done) override {
    auto outcomes = std::make_shared<std::vector<KeyTxnOutcome>>();
    add(
        [this, txns = std::move(txns), outcomes] {
          for (const KeyTxn& txn : txns) outcomes->push_back(keys_.run(txn));
        },
        [outcomes, done](const std::optional<Error>& error) {
          error ? done(*error) : done(*outcomes);
        });
  }
  void async_range(KeyRange range, Done<std::vector<KeyValue>> done) override {
    auto found = std::make_shared<std::vector<KeyValue>>();
    add(
        [this, range, found] {
          for (auto at = keys_.keys.lower_bound(range.prefix + range.from);
               at != keys_.keys.end() && at->first.starts_with(range.prefix); ++at) {
            if (range.most > 0 && found->size() == range.most) break;
            found->push_back(at->second);
          }
        },
        [found, done](const std::optional<Error>& error) { error ? done(*error) : done(*found); });
  }
  void async_grant(std::chrono::seconds /*ttl*/, Done<std::int64_t> done) override {
    add([this] { ++granted; },
        [this, done](const std::optional<Error>& error) {
          error ? done(*error) : done(std::int64_t{granted});
        });
  }
  void async_keep_alive(std::int64_t /*lease*/, Done<bool> done) override {
    add([] {},
        [this, done](const std::optional<Error>& error) {
          error ? done(*error) : done(!is_lease_over);
        });
  }
  void async_revoke(std::int64_t lease, Done<bool> done) override {
    revoked = lease;
    add([] {}, [done](const std::optional<Error>& /*error*/) { done(true); });
  }

  std::size_t sent() const { return requests_.size(); }
  /// The oldest request is carried out; once.
  void arrive() {
    if (const auto run = std::exchange(requests_.front().run, nullptr)) run();
  }
  /// Its answer comes; it is carried out before, if it was not yet.
  void deliver() { answer(std::nullopt); }
  /// No answer comes, though it may have been carried out.
  void fail() {
    requests_.front().run = nullptr;
    answer(Error{"no answer"});
  }
  /// No answer comes either; what it returns carries the request out, late.
  std::function<void()> hold() {
    auto run = std::exchange(requests_.front().run, nullptr);
    fail();
    return run;
  }
  void deliver_all() {
    while (sent() > 0) deliver();
  }

  int granted = 0;
  bool is_lease_over = false;
  std::optional<std::int64_t> revoked;

 private:
  struct Request {
    std::function<void()> run;
    std::function<void(const std::optional<Error>&)> done;
  };

  void add(std::function<void()> run, std::function<void(const std::optional<Error>&)> done) {
    requests_.push_back({std::move(run), std::move(done)});
  }
  void answer(const std::optional<Error>& error) {
    arrive();
    const auto request = std::move(requests_.front());
    requests_.pop_front();
    request.done(error);
  }

  FakeKeys& keys_;
  std::deque<Request> requests_;
};

}  // namespace orbbuf::test
