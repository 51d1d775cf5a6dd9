// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/jpeg.hpp"
#include "common/log.hpp"
#include "common/sample.hpp"
#include "server/session/session_info.hpp"
#include "server/session/session_reader.hpp"
#include "server/sink/frame_sink.hpp"
#include "server/sink/pipe/pipe_format.hpp"
#include "server/sink/pipe/pipe_reader.hpp"

namespace orbbuf {

/// What becomes of frames while the pipe has no reader.
enum class WithoutReader : std::uint8_t {
  kHold,     ///< they wait, and with them the robot's stream
  kPass,     ///< they pass the pipe by, being safe elsewhere: the next reader begins live
  kCatchUp,  ///< they pass; the next reader gets them from the session's files, before the live
             ///< ones
};

/// The frames of a session that are kept, whatever becomes of its pipe.
struct KeptFrames {
  std::filesystem::path folder;  ///< SessionStore's; empty: they are not in files
  Sequence next_sequence = 0;    ///< of the session, when the sink is made
};

/// The time since the epoch.
using WallClock = std::function<std::chrono::nanoseconds()>;

/// Feeds the frames of one session to a program that reads them live.
///
/// Every reader begins at the beginning of a frame: if one leaves in the middle of a frame, the
/// pipe is closed, a reader is looked for every second, and the next one gets that frame from its
/// start (kHold), or begins with the first one that the last did not take whole out of the pipe
/// (kCatchUp). A reader that is slow but there is waited for, which holds the robot's
/// stream, so that its policy decides what a slow program misses. Not so while a reader catches up
/// (kCatchUp): frames then pass, to be read from the files in their turn, until the reader has all
/// there is; the recording does not suffer from what SLAM once missed. A program that is slower
/// than the camera never gets there. Memory: a frame from the files and a live one.
///
/// With a frame go the samples since the last one that this reader got, whatever has become of the
/// frames between them; a first frame has those since the frame before it. Beyond
/// kMostSamples the oldest are left out; late samples are not part of the stream.
///
/// Drop records are not part of the stream. A frame that does not decode (mjpeg: is no JPEG) is
/// skipped with a warning, both images of it.
///
/// Lives in a shared_ptr, which its outstanding operations hold; close() ends them. Decoding and
/// reading files run in the `files` pool, all else on `main`. The process must ignore SIGPIPE.
class PipeSink final : public FrameSink, public std::enable_shared_from_this<PipeSink> {
 public:
  static constexpr std::size_t kMostSamples = 600'000;  ///< ten minutes at 1 kHz

  /// kept: what a sink before this one keeps of the session; for kCatchUp only. Of a session that
  /// was there before this server was started, a FIFO's reader may have all or have lost the end of
  /// the last frame to the server's death: it is given that one again. `main` and `pool` outlive
  /// the sink; the pool is stopped before `main` is destroyed.
  PipeSink(
      boost::asio::io_context& main, boost::asio::thread_pool& pool, const SessionInfo& info,
      std::unique_ptr<PipeReader> reader, PipeFormat format, WithoutReader without_reader,
      const KeptFrames& kept,
      WallClock now = [] { return std::chrono::system_clock::now().time_since_epoch(); });

  /// Begins to look for a reader. Once, before anything else.
  void start() { look_for_reader(); }

  void async_write(FramePtr frame, Done done) override;
  bool takes_items() const override { return true; }
  void async_write_items(ItemsPtr items, Done done) override;
  void cancel() override;
  /// Waits until the reader has caught up, or has left.
  void async_drain(const SessionClosing& closing, Done drained) override;
  void close() override;

 private:
  using Block = std::vector<std::uint8_t>;
  struct NamedSample {
    std::string sensor;
    Sample sample;
  };

  enum class ReaderState : std::uint8_t {
    kAwaited,  ///< asked for every second
    kPresent,  ///< pipe_ is open
    kClosed,   ///< nothing more is written: close() has been called
  };
  enum class Place : std::uint8_t {
    kLive,    ///< the reader has all before the call's frame
    kBehind,  ///< frames from next_ on may be in the files
    kMissed,  ///< likewise, and one has passed since the files were last asked
  };
  enum class Work : std::uint8_t {
    kNone,
    kLive,     ///< the call's frame is decoded or written
    kCatchUp,  ///< an older one is read from the files, decoded or written
  };
  struct Call {
    FramePtr frame;
    Done done;
    bool is_cancelled = false;
  };

  static constexpr std::chrono::seconds kRetry{1};

  void look_for_reader();
  void look_again_later();
  void watch_reader();
  void on_reader_left();
  void rewind();

  void go_on();
  void serve_call();
  void catch_up();
  void on_followed(Result<FramePtr> frame);
  void send(const FramePtr& frame);
  void add_samples(wire::StreamId stream, const std::vector<std::uint8_t>& payload,
                   std::deque<NamedSample>& samples) const;
  PipeNote note_of(const EncodedFrame& frame);
  void note_samples_sent();
  void on_encoded(const FramePtr& frame, Result<Block> block);
  void write_block(const FramePtr& frame);
  void note_sent(Sequence sequence);
  void on_sent(const FramePtr& frame);
  void finish(std::optional<Error> error);
  void log_state(LogLevel level, std::string state);

  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  const std::string label_;
  const std::string session_id_;
  const std::vector<wire::StreamDeclaration> streams_;
  const std::unique_ptr<PipeReader> reader_;
  const PipeFormat format_;
  const WithoutReader without_reader_;
  const WallClock now_;
  JpegCodec codec_;         // `files` only
  FrameFollower follower_;  // `files` only
  boost::asio::posix::stream_descriptor pipe_;
  boost::asio::steady_timer retry_;

  // go_on() decides by these what is next.
  std::optional<Call> call_;  // in progress
  ReaderState reader_state_ = ReaderState::kAwaited;
  Place place_ = Place::kLive;
  Work work_ = Work::kNone;
  Sequence next_ = 0;                // no reader needs any frame below
  std::optional<Sequence> awaited_;  // by a reader that misses nothing; nothing: any
  Block block_;                      // what is being written

  // Of the present reader, and of the last one until unread_ has been looked at.
  struct Sent {
    Sequence sequence;
    std::uint64_t end;  // in bytes of the stream
  };
  // Samples that no frame has taken to the reader: of the live stream, and of the files.
  std::deque<NamedSample> live_samples_;
  std::deque<NamedSample> followed_samples_;
  std::map<std::string, std::int64_t> samples_sent_ns_;  // by sensor: the last one's time

  std::deque<Sent> sent_;  // frames of which some may still be in the pipe
  std::uint64_t written_bytes_ = 0;
  std::optional<std::uint64_t> unread_bytes_;  // it has left, and this in the pipe

  std::function<void()> drained_;
  std::uint64_t frames_read_ = 0;  // by the present reader
  std::string last_state_;         // as logged, so that each change is logged once
};

}  // namespace orbbuf
