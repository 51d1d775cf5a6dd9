// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <functional>

namespace orbbuf {

/// The kernel's messages that a network interface, an address or a route has come or changed
/// (rtnetlink(7)): the moment at which a server may have come within reach.
///
/// Thread-bound to the thread that runs the io_context. Where the system refuses such messages, it
/// logs that and stays silent.
class NetworkNews {
 public:
  /// `changed` is called from the io_context, once for messages that come together.
  NetworkNews(boost::asio::io_context& io, std::function<void()> changed);

  void start();
  /// No more calls to `changed`.
  void stop();

 private:
  void wait();
  bool read_all();

  boost::asio::posix::stream_descriptor socket_;
  const std::function<void()> changed_;
};

}  // namespace orbbuf
