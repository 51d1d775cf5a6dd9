// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/common.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/jpeg.hpp"
#include "server/sink/frame_sink.hpp"
#include "server/sink/pipe_reader.hpp"

namespace orbbuf {

enum class PipeFormat : std::uint8_t {
  /// Binary P5 after binary P5, each with comment lines `# seq=N` and `# t=SECONDS`; of a stereo
  /// frame the left image, then the right one, with a third line `# camera=left` or `right`.
  kPgm,
  kMjpeg,  ///< JPEG after JPEG; of a stereo frame the left one, then the right one
};

/// What becomes of frames while nobody reads the pipe.
enum class WithoutReader : std::uint8_t {
  kHold,  ///< they wait, and with them the robot's stream
  kPass,  ///< they pass the pipe by, being safe elsewhere
};

/// Feeds the frames of one session to a program that reads them live.
///
/// Every reader begins at the beginning of a frame: if one leaves in the middle of a frame, the
/// pipe is closed, a reader is looked for every second, and the next one gets that frame from its
/// start (kHold). A reader that is slow but there is waited for, either way. Drop records are
/// not part of the stream. A frame that does not decode is skipped with a warning, both
/// images of it.
///
/// Lives in a shared_ptr, which its outstanding operations hold; close() ends them. Decoding runs
/// on the `files` thread, all else on `main`. The process must ignore SIGPIPE.
class PipeSink final : public FrameSink, public std::enable_shared_from_this<PipeSink> {
 public:
  /// label: whose stream it is, for the log. `main` and `pool` outlive the sink; the pool is
  /// stopped before `main` is destroyed.
  PipeSink(boost::asio::io_context& main, boost::asio::thread_pool& pool, std::string label,
           std::unique_ptr<PipeReader> reader, PipeFormat format, WithoutReader without_reader);

  /// Begins to look for a reader. Once, before anything else.
  void start();

  void async_write(FramePtr frame, Done done) override;
  void async_write_drops(std::vector<DropRecord> records, Done done) override;
  void cancel() override;
  void close() override;

 private:
  void look_for_reader();
  void look_again_later();
  void watch_reader();
  void reader_left();
  void decode();
  void decoded(Result<std::vector<std::uint8_t>> pgm);
  void write_block();
  void finish(std::optional<Error> error);
  void log_state(spdlog::level::level_enum level, std::string state);

  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  const std::string label_;
  const std::unique_ptr<PipeReader> reader_;
  const PipeFormat format_;
  const WithoutReader without_reader_;
  JpegCodec codec_;  // `files` only
  boost::asio::posix::stream_descriptor pipe_;
  boost::asio::steady_timer retry_;

  // The call in progress: done_ is set from its beginning to its end.
  FramePtr frame_;
  Done done_;
  std::vector<std::uint8_t> pgm_;  // frame_ decoded, if the format wants it
  bool is_waiting_ = false;        // for a reader; else the call is being decoded or written
  bool is_cancelled_ = false;

  bool is_closed_ = false;
  std::uint64_t frames_read_ = 0;  // by the present reader
  std::string last_state_;         // as logged, so that each change is logged once
};

/// `P5`, the comment lines, the geometry, and the pixels; of a stereo frame all of it twice.
Result<std::vector<std::uint8_t>> to_pgm(const EncodedFrame& frame, JpegCodec& codec);

}  // namespace orbbuf
