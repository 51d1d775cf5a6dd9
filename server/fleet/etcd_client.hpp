// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <utility>
#include <vector>

#include "server/fleet/etcd_channel.hpp"
#include "server/fleet/key_store.hpp"

namespace orbbuf {

/// etcd, by the JSON gateway of its v3 API (3.4 and later): txns, ranges and leases. Several txns
/// are one request, in which they are nested: one write to etcd's log for all of them. Those of
/// several calls, too, if the calls come while a request is outstanding.
class EtcdClient final : public KeyStore {
 public:
  EtcdClient(boost::asio::io_context& main, EtcdChannel::Options options)
      : main_(main), channel_(main, std::move(options)) {}

  void async_txns(std::vector<KeyTxn> txns, Done<std::vector<KeyTxnOutcome>> done) override;
  void async_range(KeyRange range, Done<std::vector<KeyValue>> done) override;
  void async_grant(std::chrono::seconds ttl, Done<std::int64_t> done) override;
  void async_keep_alive(std::int64_t lease, Done<bool> done) override;
  void async_revoke(std::int64_t lease, Done<bool> done) override;

  void stop() { channel_.stop(); }
  const EtcdChannel& channel() const { return channel_; }

 private:
  struct Call {
    std::vector<KeyTxn> txns;
    Done<std::vector<KeyTxnOutcome>> done;
  };

  void send_txns();
  std::vector<Call> take_calls();

  boost::asio::io_context& main_;
  EtcdChannel channel_;
  std::deque<Call> waiting_;
  bool is_sent_ = false;  // a request with txns
};

}  // namespace orbbuf
