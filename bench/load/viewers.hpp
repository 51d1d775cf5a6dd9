// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace orbbuf::load {

/// Programs that show what robots send, by Foxglove's WebSocket protocol: connected from the
/// constructor on, and subscribed to each channel of images. A thread of its own reads and
/// discards.
class Viewers {
 public:
  /// Throws std::runtime_error if one cannot connect.
  Viewers(std::uint16_t port, std::size_t count);
  ~Viewers();
  Viewers(const Viewers&) = delete;
  Viewers& operator=(const Viewers&) = delete;

  /// Messages that have come to all of them.
  std::uint64_t shown() const { return shown_; }

 private:
  class Viewer;

  boost::asio::io_context io_{1};
  std::atomic<std::uint64_t> shown_ = 0;
  std::vector<std::unique_ptr<Viewer>> viewers_;
  std::jthread thread_;
};

}  // namespace orbbuf::load
