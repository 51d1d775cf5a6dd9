// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/drop_record.hpp"
#include "common/event_rate.hpp"
#include "daemon/capture/stamp_clock.hpp"
#include "daemon/samples/sample_queue.hpp"
#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// Of the stream's kind. Throws std::runtime_error, saying what cannot be opened and why.
std::unique_ptr<SampleSource> make_sample_source(boost::asio::io_context& main,
                                                 const SampleStreamSettings& settings,
                                                 SampleSource::Take take);

/// All `[stream.NAME]` of a session, as numbered streams of the link: sources, queues, messages.
/// Thread-bound to `main`.
class SampleStreams {
 public:
  /// How much of a stream of samples goes in one message while no frame is sent.
  static constexpr std::chrono::milliseconds kBatch{20};

  /// `on_due` is called when a batch of samples or a message of a topic waits, also within
  /// on_frame(). Throws std::runtime_error if a source cannot be opened.
  SampleStreams(boost::asio::io_context& main, const std::vector<SampleStreamSettings>& settings,
                std::function<void()> on_due);
  SampleStreams(const SampleStreams&) = delete;
  SampleStreams& operator=(const SampleStreams&) = delete;

  /// For the hello.
  std::vector<wire::StreamDeclaration> declarations() const;

  /// Of times by the system's clock, as drivers and ROS 2 stamp, it makes those of the frames'.
  /// What drivers measure before the first frame is then not taken: that frame's clock is not known
  /// yet.
  void set_clock(std::function<std::int64_t(std::int64_t time_ns)> session_time) {
    session_time_ = std::move(session_time);
  }

  /// The stamps of the frames have jumped by that, in all, and their times have not.
  void set_frames_step(std::int64_t step_ns) { frames_step_ns_ = step_ns; }

  /// A frame of that time was captured.
  void on_frame(std::int64_t time_ns);
  /// As SampleQueue has them.
  void on_frame_sent(std::int64_t time_ns);
  void on_frames_dropped(const std::vector<DropRecord>& drops);
  void on_last_frame_sent();

  /// No more samples will come.
  void stop();

  /// As the welcome of a new connection says. A stream that the server does not take is not sent.
  void on_connected(const wire::Position& position,
                    const std::function<bool(wire::StreamId)>& takes);
  void on_ack(const wire::Position& position);
  bool can_be_at(const wire::Position& position) const;

  /// Samples not sent yet, up to `upto_ns`, for a message; nothing: there are none.
  std::optional<wire::Items> take_message(std::int64_t upto_ns);
  /// The same, of a stream of which a batch waits, or what waits behind no newer one for kBatch.
  std::optional<wire::Items> take_batch(EventRate::Time now = EventRate::Clock::now());

  /// All that the server takes is acknowledged.
  bool is_settled() const;
  struct Progress {
    wire::StreamDeclaration stream;
    std::uint64_t captured = 0;
    std::uint64_t first_waiting = 0;  ///< those below it are with the server, late, or lost
  };
  using SendLate = std::function<std::uint64_t(wire::StreamId, const SampleQueue::Range&)>;
  /// Hands those that wait and are not in the robot's record yet to `keep`, which says whether they
  /// are now; and those that the record is to send to `send_late`, which says how many of them it
  /// has lost. Then how far each stream is.
  std::vector<Progress> record(const std::function<bool(const wire::Items&)>& keep,
                               const SendLate& send_late);
  /// Sets in a bye's position how far the streams reach.
  void put_ends(wire::Position& position) const;
  /// For a report: how many of each were captured.
  wire::Position captured() const;
  /// For the log: `imu0 captured 2000 = delivered 1990 + late 0 + waiting 10 + lost 0`, and until
  /// stop() `, 200.0/s, newest 3 ms old`; with `; ` between streams.
  std::string stats(EventRate::Time now = EventRate::Clock::now()) const;

 private:
  struct Stream {
    wire::StreamDeclaration declaration;
    SampleQueue queue;
    StampClock stamps;  // of a driver's samples
    EventRate rate{};
    EventRate::Time newest{};  // when it came
    std::unique_ptr<SampleSource> source{};
    bool has_system_time = false;
    bool is_of_driver = false;  // measured now
    bool is_taken = true;
    bool is_refusal_logged = false;
    std::uint64_t lost_logged = 0;
  };

  void take(Stream& stream, Sample sample);
  static bool has_batch(const Stream& stream);
  static std::optional<wire::Items> take_from(Stream& stream, std::int64_t upto_ns);

  const std::function<void()> on_due_;
  std::function<std::int64_t(std::int64_t)> session_time_;
  bool has_frames_ = false;
  std::int64_t frames_step_ns_ = 0;
  std::vector<Stream> streams_;  // as many as at first: their sources know them
};

}  // namespace orbbuf
