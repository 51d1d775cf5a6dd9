// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/address.hpp"
#include "common/error.hpp"
#include "server/fleet/key_store.hpp"

namespace orbbuf::fleet {

/// Servers and sessions as JSON, for people: a page of kPage sessions at a time, read from etcd.
/// However many ask, a page is read once in kFresh, so that they cost the robots nothing to speak
/// of. Thread-bound to `main`.
class Overview {
 public:
  static constexpr std::size_t kPage = 500;
  static constexpr std::chrono::seconds kFresh{2};
  using Done = std::function<void(const Result<std::string>&)>;

  /// `store`: not the way that a lease is kept alive by, which must not wait. It must outlive this.
  /// `etcd`: for the viewer.
  Overview(KeyStore& store, std::vector<Address> etcd) : store_(store), etcd_(std::move(etcd)) {}

  /// The page that begins with that session, ROBOT/SESSION; empty: the first. `next` in it is the
  /// first session of the page behind it.
  void async_page(const std::string& from, const Done& done);

 private:
  using Clock = std::chrono::steady_clock;

  struct Page {
    std::optional<Clock::time_point> read_at;  // nothing: it is being read
    std::string json;
    std::vector<Done> waiting;
  };
  using Keys = std::vector<KeyValue>;

  void read(const std::string& from);
  void finish(const std::string& from, const Result<std::string>& json);
  std::string to_json(const Keys& servers, Keys owners, const Keys& positions) const;

  KeyStore& store_;
  const std::vector<Address> etcd_;
  std::map<std::string, Page> pages_;  // by `from`
};

}  // namespace orbbuf::fleet
