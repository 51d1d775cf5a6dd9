// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

/// A key as the store has it.
struct KeyValue {
  std::string key;
  std::string value;
  std::int64_t mod_revision = 0;  ///< of the change that wrote it, never 0

  friend bool operator==(const KeyValue&, const KeyValue&) = default;
};

/// If each key of `compare` still has that value, or that revision (0: it is not there), all of
/// `puts` are done, else none.
struct KeyTxn {
  struct Compare {
    std::string key;
    std::int64_t mod_revision = 0;
    std::optional<std::string> value{};  ///< then the revision does not count
  };
  struct Put {
    std::string key;
    std::string value;
    std::int64_t lease = 0;  ///< 0: none, the key stays
  };
  std::vector<Compare> compare;
  std::vector<Put> puts;
  std::vector<std::string> reads;               ///< in either case, after the puts
  std::vector<std::string> reads_if_refused{};  ///< if none is done, too
};

/// The keys that begin with `prefix`, in order; of these, if `most` is not 0, so many from
/// `prefix` + `from` on.
struct KeyRange {
  explicit KeyRange(std::string_view all, std::string first = "", std::size_t count = 0)
      : prefix(all), from(std::move(first)), most(count) {}

  std::string prefix;
  std::string from;
  std::size_t most;
};

struct KeyTxnOutcome {
  bool is_done = false;
  std::int64_t revision = 0;    ///< of the store: that of the puts, if they are done
  std::vector<KeyValue> found;  ///< of those to read, those that are there

  /// Null: it is not among `found`.
  const KeyValue* find(const std::string& key) const {
    const auto at = std::ranges::find(found, key, &KeyValue::key);
    return at == found.end() ? nullptr : &*at;
  }
};

/// The few keys that the servers of a fleet share: etcd, or what a test puts in its place. Every
/// call is answered once, on `main`, never from within the call; an error means that it is not
/// known whether the call took effect. Thread-bound to `main`.
class KeyStore {
 public:
  template <class T>
  using Done = std::function<void(Result<T>)>;

  virtual ~KeyStore() = default;

  /// Each txn by itself, all in one request: at most kMostTxns, no key put by two of them.
  static constexpr std::size_t kMostTxns = 100;
  virtual void async_txns(std::vector<KeyTxn> txns, Done<std::vector<KeyTxnOutcome>> done) = 0;
  virtual void async_range(KeyRange range, Done<std::vector<KeyValue>> done) = 0;

  /// A lease that lasts so long after each renewal; its keys go with it.
  virtual void async_grant(std::chrono::seconds ttl, Done<std::int64_t> done) = 0;
  /// False: it has expired.
  virtual void async_keep_alive(std::int64_t lease, Done<bool> done) = 0;
  virtual void async_revoke(std::int64_t lease, Done<bool> done) = 0;
};

}  // namespace orbbuf
