// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/datagram_protocol.hpp>
#include <string>

#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// Takes samples from drivers on this machine: each datagram to a Unix socket has one or more lines
/// in the form of EuRoC's imu0/data.csv. A driver that is faster than `main` waits in its send().
class SocketSamples final : public SampleSource {
 public:
  static constexpr std::size_t kMaxDatagramBytes = std::size_t{64} << 10U;

  /// Listens at once; a socket that a dead orbbufd has left behind is replaced. Every user who may
  /// enter its folder may write to it. Throws std::runtime_error, `NAME: listen on PATH: why`, also
  /// if another process listens there.
  SocketSamples(boost::asio::io_context& main, const SampleStreamSettings& settings, Take take);
  ~SocketSamples() override;
  SocketSamples(const SocketSamples&) = delete;
  SocketSamples& operator=(const SocketSamples&) = delete;

 private:
  void receive();
  void read(std::string_view text);

  const std::string name_;
  const std::filesystem::path path_;
  const Take take_;
  boost::asio::local::datagram_protocol::socket socket_;
  std::array<char, kMaxDatagramBytes> datagram_{};
  bool is_fault_logged_ = false;
};

}  // namespace orbbuf
