// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace orbbuf {

/// The network interfaces over which attempts to connect go in turn. The first is preferred: while
/// another carries the stream, the preferred one is probed, and when all probes have been answered
/// for `return_after` it is time to go back. If that fails, or the stream leaves the preferred
/// interface again less than a minute after its return, the next return takes twice as long, at
/// most 5 minutes.
/// Knows no clock and no socket. Reentrant.
class LinkInterfaces {
 public:
  using Time = std::chrono::steady_clock::time_point;
  using Duration = std::chrono::nanoseconds;

  /// No names: one interface with an empty name, which is the kernel's choice.
  LinkInterfaces(std::vector<std::string> names, Duration return_after);

  unsigned count() const { return static_cast<unsigned>(names_.size()); }
  const std::string& preferred() const { return names_.front(); }

  /// The interface for the next attempt.
  const std::string& next();
  /// Whether the next attempt is the first of a round, in which each interface has its turn.
  bool is_round_begin() const { return turn_ == first_; }
  /// The next attempts begin with the preferred one.
  void start_over() { turn_ = first_ = 0; }
  /// The stream's interface fails it: the next attempts begin with the one after.
  void on_stall() { turn_ = first_ = (stream_ + 1) % names_.size(); }

  /// The stream is on `interface` from `now`.
  void on_connected(const std::string& interface, Time now);

  /// Whether to see `now` if the preferred interface reaches the server.
  bool is_probe_due(Time now) const;
  /// A probe begins; if the one before is unanswered, it has failed.
  void on_probe(Time now);
  void on_probe_failed() { well_since_.reset(); }
  /// The probe is answered. Returns whether it is time to go back.
  bool on_answer(Time now);
  /// The probe that was answered was to carry the stream, and could not.
  void on_return_failed();

 private:
  void double_patience();

  const std::vector<std::string> names_;
  const Duration return_after_;
  std::size_t first_ = 0;  // of a round
  std::size_t turn_ = 0;
  std::size_t stream_ = 0;             // the one that carries the stream
  Duration patience_ = return_after_;  // of the next return
  std::optional<Time> returned_;       // when the stream last came back to the preferred one
  Time probe_time_{};
  bool is_answered_ = false;
  std::optional<Time> well_since_;  // all probes since then are answered
};

}  // namespace orbbuf
