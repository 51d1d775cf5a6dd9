// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "common/drop_record.hpp"
#include "common/wire.hpp"
#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/net/backfill.hpp"
#include "daemon/net/link_rate.hpp"
#include "daemon/net/reporter.hpp"
#include "daemon/net/server_link.hpp"
#include "daemon/record/given_up.hpp"
#include "daemon/record/record.hpp"
#include "daemon/samples/sample_streams.hpp"

namespace orbbuf {

/// Chooses what goes over the link, until finish(): frames from the buffer, samples, drop records,
/// reports.
///
/// The next frame is chosen when the kernel has nearly nothing left to send (paper, Sec. III-E:
/// transmission of a message begins when the last is complete) and the server has received all but
/// little of what was written (LinkRate): what is written can no longer be chosen from.
/// Before a frame go the samples that are not newer than it, so none is behind a newer frame.
/// Every frame stays in the buffer's stats until the server has acknowledged it; every drop
/// record is sent until acknowledged. Thread-bound to `main`, the thread that runs the io_context.
class Sender final : private ServerLink::Owner {
 public:
  /// `buffer`, `record` and `samples` must outlive the sender. Nothing happens before start().
  /// Throws std::runtime_error if the keys of settings.tls cannot be used.
  Sender(boost::asio::io_context& io, const LinkSettings& settings, wire::Hello hello,
         FrameBuffer& buffer, Record& record, SampleStreams& samples);

  void start();

  /// There may be something new to send.
  void wake();
  /// A frame was pushed.
  void on_pushed();

  /// For the reports: wire::Report::clock_offset_ns.
  void set_clock_offset(std::chrono::nanoseconds offset) { clock_offset_ = offset; }

  const ServerLink& link() const { return link_; }
  /// Frames that the record holds; nothing if it keeps none.
  std::optional<std::uint64_t> spooled() const;
  const SampleStreams& samples() const { return samples_; }
  void reload_tls() { link_.reload_tls(); }

  /// No more frames will come: delivers what waits, for at most drain_timeout, gives up the rest by
  /// name, and says bye. Then `done` is called, with true if the server has the whole record.
  void finish(std::function<void(bool complete)> done);
  /// Ends at once, without a call of `done`: what waits is given up by name, for the record alone.
  void abandon();
  /// After the end: frames that waited for it, and that neither the server nor the record has.
  std::uint64_t lost() const { return lost_; }

 private:
  void on_connected(const wire::Position& position) override;
  bool can_be_at(const wire::Position& position) const override;
  void on_disconnected() override;
  void on_ack(const wire::Ack& ack) override;
  void on_bye(const wire::Position& position) override;
  void on_writable() override { write_next(); }

  void report_each_second();
  void write_next();
  bool write(const std::optional<wire::Items>& items);
  void write_late(std::chrono::nanoseconds round_trip);
  bool is_live(std::chrono::steady_clock::time_point now,
               std::chrono::nanoseconds round_trip) const;
  FramePtr take_frame(std::chrono::nanoseconds round_trip);
  SendMoment moment(std::chrono::steady_clock::time_point now,
                    std::chrono::nanoseconds round_trip) const;
  void write_chosen();
  bool is_too_large(const EncodedFrame& frame);
  void collect(bool those_at_risk = false);
  void note_progress();
  bool is_settled() const;
  std::chrono::nanoseconds measure_round_trip() const;
  void write_report();
  std::vector<std::uint8_t> next_report();
  void say_bye();
  void give_up_waiting();
  void end(bool complete);

  FrameBuffer& buffer_;
  Record& record_;
  GivenUp drops_;
  std::vector<DropRecord> collected_;  // on their way from buffer_ to drops_
  FrameBuffer::ForRecord for_record_;  // from buffer_ to record_
  const std::chrono::nanoseconds drain_timeout_;
  ServerLink link_;
  LinkRate rate_;
  Backfill backfill_;
  Reporter reporter_;
  boost::asio::steady_timer drain_timer_;
  boost::asio::steady_timer report_timer_;
  std::chrono::nanoseconds clock_offset_{0};
  SampleStreams& samples_;
  FramePtr chosen_;  // taken from buffer_; samples go first
  bool is_drops_turn_ = false;
  Sequence confirmed_ = 0;    // the server has, or had, all below it
  Sequence written_end_ = 0;  // beyond the newest frame that was ever written
  bool is_refusal_logged_ = false;
  bool is_bye_sent_ = false;
  std::uint64_t not_kept_ = 0;  // by the record, when finishing began
  std::uint64_t lost_ = 0;
  std::function<void(bool)> done_;  // set: finishing
};

}  // namespace orbbuf
