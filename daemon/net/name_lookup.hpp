// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <functional>
#include <memory>
#include <vector>

#include "common/address.hpp"
#include "common/error.hpp"

namespace orbbuf {

/// Looks up the addresses of servers by their names, without holding up the thread that asks,
/// neither meanwhile nor at the end: each lookup has a thread of its own, which nothing waits for.
/// A name server behind a dead link keeps such a thread for tens of seconds; several may therefore
/// be on their way, so that the first to be sent after the link's return is answered.
///
/// Thread-bound to the thread that runs the io_context, which must outlive the lookup.
class NameLookup {
 public:
  using Endpoints = std::vector<boost::asio::ip::tcp::endpoint>;
  /// At least one endpoint of the server, or why there is none. Called from the io_context.
  using Found = std::function<void(const Address& server, const Result<Endpoints>&)>;

  NameLookup(boost::asio::io_context& io, Found found);
  /// No more calls to `found`.
  ~NameLookup();

  /// Does nothing while five lookups of that server are on their way.
  void start(const Address& server);

 private:
  struct Shared;

  const std::shared_ptr<Shared> shared_;
};

}  // namespace orbbuf
