// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <chrono>
#include <cstddef>
#include <memory>
#include <thread>

#include "common/net/tls.hpp"

namespace orbbuf::bench {

/// Asks a server's page for /healthz ten times a second, by a connection each time, as Kubernetes
/// does: an answer that does not come within kPatience is a failure. From the constructor to
/// stop().
class Probe {
 public:
  static constexpr std::chrono::milliseconds kInterval{100};
  static constexpr std::chrono::seconds kPatience{1};

  /// `tls`: of a robot; off: plain HTTP.
  Probe(const boost::asio::ip::tcp::endpoint& page, const TlsSettings& tls);

  void stop() { thread_ = {}; }
  // After stop().
  std::size_t count() const { return count_; }
  std::size_t failures() const { return failures_; }
  std::chrono::nanoseconds longest() const { return longest_; }

 private:
  bool ask(const boost::asio::ip::tcp::endpoint& page) const;

  const std::shared_ptr<TlsContext> tls_;
  std::size_t count_ = 0;
  std::size_t failures_ = 0;
  std::chrono::nanoseconds longest_{0};
  std::jthread thread_;
};

}  // namespace orbbuf::bench
