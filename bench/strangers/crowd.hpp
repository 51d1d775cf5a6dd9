// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

namespace orbbuf::bench {

/// Connections that say what `words` gives for each, and then nothing. One that the other end
/// closes is made again, as fast as `rate` allows. They come from kAddresses of 127.0.0.0/8, none
/// of which is 127.0.0.1. Thread-bound to the thread that runs the io_context; lives in a
/// shared_ptr, which its operations hold.
class Crowd : public std::enable_shared_from_this<Crowd> {
 public:
  static constexpr unsigned kAddresses = 20;

  struct Options {
    boost::asio::ip::tcp::endpoint to;
    std::size_t size = 0;               ///< at a time
    std::size_t rate = 2000;            ///< new ones a second
    bool leaves_when_answered = false;  ///< and the next comes
    std::function<std::vector<std::uint8_t>()> words;
  };
  Crowd(boost::asio::io_context& io, Options options) : options_(std::move(options)), timer_(io) {}

  void start() { grow(); }
  /// All leave.
  void stop();
  /// That were made so far.
  std::size_t count() const { return count_; }

 private:
  using Tcp = boost::asio::ip::tcp;
  struct One {
    explicit One(boost::asio::io_context& io) : socket(io) {}
    Tcp::socket socket;
    std::vector<std::uint8_t> words;
    std::uint8_t answer[512];
  };

  void grow();
  void connect();
  void read(const std::shared_ptr<One>& one);
  void leave(const std::shared_ptr<One>& one);

  const Options options_;
  boost::asio::steady_timer timer_;
  std::vector<std::shared_ptr<One>> all_;
  std::size_t count_ = 0;
  bool is_stopped_ = false;
};

}  // namespace orbbuf::bench
