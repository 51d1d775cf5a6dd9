// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "daemon/samples/sample_queue.hpp"
#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// All `[stream.NAME]` of a session, as numbered streams of the link: sources, queues, messages.
/// Thread-bound to `main`.
class SampleStreams {
 public:
  /// Throws std::runtime_error if a source cannot be opened.
  explicit SampleStreams(const std::vector<SampleStreamSettings>& settings = {});

  /// For the hello.
  std::vector<wire::StreamDeclaration> declarations() const;

  /// A frame of that time was captured: takes the samples up to it from the sources.
  void capture_until(std::int64_t time_ns);

  /// As the welcome of a new connection says. A stream that the server does not take is not sent.
  void on_connected(const wire::Position& position, const std::vector<bool>& takes);
  void on_ack(const wire::Position& position);
  bool can_be_at(const wire::Position& position) const;

  /// A message with samples not sent yet, up to `upto_ns`; empty: there are none.
  std::vector<std::uint8_t> take_message(std::int64_t upto_ns);

  /// All that the server takes is acknowledged.
  bool is_settled() const;
  /// Sets in a bye's position how far the streams reach.
  void put_ends(wire::Position& position) const;
  /// For the log: ` imu0 captured 2000 = delivered 1990 + waiting 10 + lost 0`, one after the
  /// other.
  std::string stats() const;

 private:
  struct Stream {
    wire::StreamDeclaration declaration;
    std::unique_ptr<SampleSource> source;
    SampleQueue queue;
    bool is_taken = true;
    std::uint64_t lost_logged = 0;
  };

  std::vector<Stream> streams_;
};

}  // namespace orbbuf
