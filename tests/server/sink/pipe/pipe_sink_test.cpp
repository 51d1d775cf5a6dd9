// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/pipe_sink.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/post.hpp>
#include <utility>

#include "server/session/session_store.hpp"
#include "server/sink/pipe/child_process.hpp"
#include "server/sink/pipe/fifo.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::as_text;
using test::jpeg_frame_ptr;
using test::jpeg_like_frame_ptr;
using test::stereo_frame_ptr;

constexpr std::size_t kBig = 300'000;      // several times what a pipe holds
constexpr std::chrono::seconds kNow{100};  // by the server's clock
const SessionInfo kSession{"robot", "session", ""};

/// What a pipe in the format mjpeg has of such a frame.
std::string in_pipe(Sequence sequence, std::size_t bytes = 100, std::uint64_t missed = 0) {
  const auto frame = jpeg_like_frame_ptr(sequence, bytes);
  const auto age = kNow - std::chrono::nanoseconds(frame->capture_time_ns);
  return as_text(to_mjpeg(*frame, {"session", missed, age}).value());
}

const SessionInfo kInertial{"robot", "session", "", {{4, "imu0", "imu"}}};

ItemsPtr sample_at(std::int64_t time_ns) {
  const std::vector<Sample> one{{time_ns, {}, {}}};
  return std::make_shared<wire::Items>(wire::Items{4, 0, wire::encode_samples(one)});
}

class PipeSinkTest : public test::EventLoop {
 protected:
  ~PipeSinkTest() override {
    for (const auto& sink : sinks_) sink->close();
    run_until([] { return has_no_children(); });
    run_ready();
  }

  PipeSink& sink(std::unique_ptr<PipeReader> reader, PipeFormat format, WithoutReader without,
                 const SessionInfo& info = kSession, const KeptFrames& kept = {}) {
    sinks_.push_back(std::make_shared<PipeSink>(main_, files_, info, std::move(reader), format,
                                                without, kept, [] { return kNow; }));
    sinks_.back()->start();
    return *sinks_.back();
  }
  PipeSink& fifo_sink(PipeFormat format, WithoutReader without = WithoutReader::kHold) {
    return sink(std::make_unique<Fifo>(fifo_), format, without);
  }
  PipeSink& child_sink(const std::string& command, WithoutReader without = WithoutReader::kHold) {
    return sink(std::make_unique<ChildProcess>(main_, "robot session", command,
                                               std::vector<std::string>{}, Restart::kAlways),
                PipeFormat::kMjpeg, without);
  }

  UniqueFd reader() const {
    ::mkfifo(fifo_.c_str(), 0600);
    return UniqueFd(::open(fifo_.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  }
  /// Reads exactly so much while the sink writes.
  std::string read(const UniqueFd& fd, std::size_t bytes) {
    std::string got;
    run_until([&] {
      std::array<char, 4096> block;
      const ssize_t n = ::read(fd.get(), block.data(), std::min(block.size(), bytes - got.size()));
      if (n > 0) got.append(block.data(), static_cast<std::size_t>(n));
      return got.size() == bytes;
    });
    return got;
  }
  /// Starts a write; the answer comes to `answers_`.
  void begin(PipeSink& sink, FramePtr frame) {
    sink.async_write(std::move(frame),
                     [this](const std::optional<Error>& e) { answers_.push_back(e); });
  }
  bool run_until_answered(std::size_t count = 1) {
    return run_until([&] { return answers_.size() == count; });
  }

  test::TemporaryFolder folder_;
  std::filesystem::path fifo_ = folder_ / "fifo";
  std::vector<std::shared_ptr<PipeSink>> sinks_;
  std::vector<std::optional<Error>> answers_;
};

TEST_F(PipeSinkTest, MjpegIsOneJpegAfterTheOtherAndTellsWhatIsMissing) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kMjpeg);
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(0)));
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(3, 50)));
  EXPECT_EQ(read(end, in_pipe(0).size() + in_pipe(3, 50, 2).size()),
            in_pipe(0) + in_pipe(3, 50, 2));
}

TEST_F(PipeSinkTest, SamplesGoWithTheNextFrameAlsoBehindOneThatIsSkipped) {
  const UniqueFd end = reader();
  auto& out =
      sink(std::make_unique<Fifo>(fifo_), PipeFormat::kPgm, WithoutReader::kHold, kInertial);
  for (const std::int64_t time_ns : {10, 20}) EXPECT_FALSE(write(out, sample_at(time_ns)));
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(1)));  // does not decode
  EXPECT_FALSE(write(out, sample_at(30)));
  EXPECT_FALSE(write(out, jpeg_frame_ptr(2, 16, 16)));
  EXPECT_FALSE(write(out, jpeg_frame_ptr(3, 16, 16)));
  const std::string head =
      "P5\n# seq=2\n# t=0.080000000\n# age=99.920\n# session=session\n# imu0=10,0,0,0,0,0,0\n"
      "# imu0=20,0,0,0,0,0,0\n# imu0=30,0,0,0,0,0,0\n16 16\n255\n";
  EXPECT_EQ(read(end, head.size()), head);
  read(end, 256);
  const std::string next = "P5\n# seq=3\n# t=0.120000000\n# age=99.880\n# session=session\n16 16\n";
  EXPECT_EQ(read(end, next.size()), next);
}

TEST_F(PipeSinkTest, SamplesOfFramesFromTheFilesComeFromThere) {
  auto store = SessionStore::open(folder_ / "kept", kInertial, Durability::kOff);
  ASSERT_TRUE(store);
  SessionStore& kept = *store.value();
  auto& out = sink(std::make_unique<Fifo>(fifo_), PipeFormat::kPgm, WithoutReader::kCatchUp,
                   kInertial, {folder_ / "kept", 0});
  std::uint64_t number = 0;
  const auto record = [&](std::int64_t time_ns) {
    const ItemsPtr items = sample_at(time_ns);
    EXPECT_FALSE(kept.write_items({4, number, number + 1, items->payload}));
    ++number;
    EXPECT_FALSE(write(out, items));
  };
  for (const Sequence sequence : {0U, 1U}) {  // without a reader
    record(static_cast<std::int64_t>(10 * sequence));
    EXPECT_FALSE(kept.write(*jpeg_frame_ptr(sequence, 16, 16), 0));
    EXPECT_FALSE(write(out, jpeg_frame_ptr(sequence, 16, 16)));
  }
  record(20);
  const UniqueFd end = reader();
  const auto head = [](int sequence, const std::string& samples) {
    return fmt::format(
        "P5\n# seq={}\n# t=0.0{}0000000\n# age={}\n# session=session\n{}16 16\n255\n", sequence,
        4 * sequence, sequence == 0 ? "100.000" : "99.960", samples);
  };
  for (const int sequence : {0, 1}) {
    const auto expected = head(sequence, fmt::format("# imu0={},0,0,0,0,0,0\n", 10 * sequence));
    EXPECT_EQ(read(end, expected.size()), expected);
    read(end, 256);
  }
  record(30);
  EXPECT_FALSE(kept.write(*jpeg_frame_ptr(2, 16, 16), 0));
  EXPECT_FALSE(write(out, jpeg_frame_ptr(2, 16, 16)));
  const std::string last =
      "P5\n# seq=2\n# t=0.080000000\n# age=99.920\n# session=session\n"
      "# imu0=20,0,0,0,0,0,0\n# imu0=30,0,0,0,0,0,0\n";
  EXPECT_EQ(read(end, last.size()), last);
}

TEST_F(PipeSinkTest, AReplayWithTheTimesOfItsRecordingTellsNoAge) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kPgm);
  EncodedFrame frame = *jpeg_frame_ptr(41, 24, 10);
  frame.capture_time_ns = -24LL * 3600 * 1'000'000'000 + 100'000'000'000;
  EXPECT_FALSE(write(out, std::make_shared<EncodedFrame>(std::move(frame))));
  const std::string head = "P5\n# seq=41\n# t=-86300.000000000\n# session=session\n24 10\n255\n";
  EXPECT_EQ(read(end, head.size()), head);
}

TEST_F(PipeSinkTest, PgmTellsSequenceAndTimeAndHoldsThePixels) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kPgm);
  const auto frame = jpeg_frame_ptr(41, 24, 10);
  EXPECT_FALSE(write(out, frame));
  const std::string head =
      "P5\n# seq=41\n# t=1.640000000\n# age=98.360\n# session=session\n24 10\n255\n";
  JpegCodec codec;
  EXPECT_EQ(read(end, head.size() + 240),
            head + as_text(codec.decode_gray(frame->jpeg, 1).value().pixels));
}

TEST_F(PipeSinkTest, PgmOfAStereoFrameIsTheLeftImageThenTheRightOne) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kPgm);
  const auto frame = stereo_frame_ptr(jpeg_frame_ptr(41, 24, 10), jpeg_frame_ptr(42, 24, 10));
  EXPECT_FALSE(write(out, frame));
  const std::string head = "P5\n# seq=41\n# t=1.640000000\n# camera=";
  JpegCodec codec;
  const std::string expected = head + "left\n# age=98.360\n# session=session\n24 10\n255\n" +
                               as_text(codec.decode_gray(frame->left(), 1).value().pixels) + head +
                               "right\n# age=98.360\n# session=session\n24 10\n255\n" +
                               as_text(codec.decode_gray(frame->right(), 1).value().pixels);
  EXPECT_EQ(read(end, expected.size()), expected);
}

TEST_F(PipeSinkTest, AStereoFrameWithOneImageThatDoesNotDecodeIsSkippedWhole) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kPgm);
  EXPECT_FALSE(write(out, stereo_frame_ptr(jpeg_frame_ptr(1, 16, 16), jpeg_like_frame_ptr(1))));
  EXPECT_FALSE(write(out, jpeg_frame_ptr(2, 16, 16)));
  EXPECT_EQ(read(end, 11), "P5\n# seq=2\n");
}

TEST_F(PipeSinkTest, AFrameThatDoesNotDecodeIsSkippedWithAWarning) {
  const test::CapturedLog log;
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kPgm);
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(1)));
  EXPECT_FALSE(write(out, jpeg_frame_ptr(2, 16, 16)));
  EXPECT_EQ(read(end, 11), "P5\n# seq=2\n");
  EXPECT_EQ(log.lines("warning robot session: " + fifo_.string() + ": skipped frame 1").size(), 1U);
}

TEST_F(PipeSinkTest, AloneItHoldsFramesUntilAReaderComes) {
  const test::CapturedLog log;
  auto& out = fifo_sink(PipeFormat::kMjpeg);
  begin(out, jpeg_like_frame_ptr(0));
  run_ready();
  EXPECT_TRUE(answers_.empty());
  const UniqueFd end = reader();
  ASSERT_TRUE(run_until_answered());
  EXPECT_EQ(read(end, in_pipe(0).size()), in_pipe(0));
  EXPECT_EQ(log.lines("no reader").size(), 1U);
  EXPECT_EQ(log.lines("has a reader").size(), 1U);
}

TEST_F(PipeSinkTest, BesideFilesItLetsFramesPassUntilAReaderComes) {
  auto& out = fifo_sink(PipeFormat::kMjpeg, WithoutReader::kPass);
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(0)));
  const UniqueFd end = reader();
  Sequence sequence = 0;
  std::string got;
  ASSERT_TRUE(run_until([&] {
    EXPECT_FALSE(write(out, jpeg_like_frame_ptr(++sequence)));
    std::array<char, 1000> block{};
    const ssize_t n = ::read(end.get(), block.data(), block.size());
    if (n > 0) got.assign(block.data(), static_cast<std::size_t>(n));
    return !got.empty();
  }));
  EXPECT_EQ(got, in_pipe(sequence));
}

TEST_F(PipeSinkTest, ASlowReaderIsWaitedForEvenBesideFiles) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kMjpeg, WithoutReader::kPass);
  begin(out, jpeg_like_frame_ptr(0, kBig));
  run_ready();
  EXPECT_TRUE(answers_.empty());
  EXPECT_EQ(read(end, in_pipe(0, kBig).size()), in_pipe(0, kBig));
  ASSERT_TRUE(run_until_answered());
  EXPECT_FALSE(answers_[0]);
}

TEST_F(PipeSinkTest, TheNextReaderBeginsWithTheFrameThatTheLastOneLeft) {
  const test::CapturedLog log;
  auto& out = fifo_sink(PipeFormat::kMjpeg);
  {
    const UniqueFd first = reader();
    begin(out, jpeg_like_frame_ptr(0));
    ASSERT_TRUE(run_until_answered());
    begin(out, jpeg_like_frame_ptr(1, kBig));
    EXPECT_EQ(read(first, 1100).size(), 1100U);  // a frame, and the beginning of one
  }
  ASSERT_TRUE(run_until([&] { return log.lines("lost its reader after 1 frames").size() == 1; }));
  EXPECT_EQ(answers_.size(), 1U);
  const UniqueFd second = reader();
  EXPECT_EQ(read(second, in_pipe(1, kBig).size()), in_pipe(1, kBig));
  ASSERT_TRUE(run_until_answered(2));
  EXPECT_FALSE(answers_[1]);
}

TEST_F(PipeSinkTest, AReaderThatLeavesBetweenFramesIsNoticedAtOnce) {
  const test::CapturedLog log;
  {
    const UniqueFd first = reader();
    auto& out = fifo_sink(PipeFormat::kMjpeg);
    EXPECT_FALSE(write(out, jpeg_like_frame_ptr(0)));
  }
  EXPECT_TRUE(run_until([&] { return log.lines("lost its reader").size() == 1; }));
}

TEST_F(PipeSinkTest, CancelEndsTheWaitForAReader) {
  auto& out = fifo_sink(PipeFormat::kMjpeg);
  begin(out, jpeg_like_frame_ptr(0));
  run_ready();
  out.cancel();
  ASSERT_TRUE(run_until_answered());
  ASSERT_TRUE(answers_[0]);
  EXPECT_EQ(answers_[0]->text, "write to " + fifo_.string() + ": no reader");
  const UniqueFd end = reader();
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(0)));
}

TEST_F(PipeSinkTest, CancelDoesNotTearAFrameThatIsBeingRead) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kMjpeg);
  begin(out, jpeg_like_frame_ptr(0, kBig));
  run_ready();
  out.cancel();
  EXPECT_EQ(read(end, in_pipe(0, kBig).size()), in_pipe(0, kBig));
  ASSERT_TRUE(run_until_answered());
  EXPECT_FALSE(answers_[0]);
}

TEST_F(PipeSinkTest, CloseEndsAWriteThatNobodyReadsAndShowsTheReaderTheEnd) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kMjpeg);
  begin(out, jpeg_like_frame_ptr(0, kBig));
  run_ready();
  out.close();
  ASSERT_TRUE(run_until_answered());
  EXPECT_TRUE(answers_[0]);
  std::array<char, 4096> block;
  ssize_t n = 0;
  while ((n = ::read(end.get(), block.data(), block.size())) > 0) {
  }
  EXPECT_EQ(n, 0);  // the end, not EAGAIN
}

TEST_F(PipeSinkTest, ACommandGetsTheStreamAndItsEnd) {
  auto& out = child_sink("cat > " + (folder_ / "out").string());
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(0, kBig)));
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(1, kBig)));
  out.close();
  ASSERT_TRUE(run_until([] { return has_no_children(); }));
  EXPECT_EQ(test::read_file(folder_ / "out"), in_pipe(0, kBig) + in_pipe(1, kBig));
}

TEST_F(PipeSinkTest, ACommandThatEndsTooEarlyIsStartedAgainAtAFrame) {
  const std::string first = (folder_ / "first").string();
  const std::string second = (folder_ / "second").string();
  auto& out = child_sink("if [ -e " + first + " ]; then cat > " + second +
                         "; else head -c 1000 > " + first + "; fi");
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(0, kBig)));
  out.close();
  ASSERT_TRUE(run_until([] { return has_no_children(); }));
  EXPECT_EQ(std::filesystem::file_size(first), 1000U);
  EXPECT_EQ(test::read_file(second), in_pipe(0, kBig));
}

TEST_F(PipeSinkTest, APathThatIsNoFifoIsOneErrorAndTriedAgain) {
  const test::CapturedLog log;
  test::write_file(fifo_, "data");
  auto& out = fifo_sink(PipeFormat::kMjpeg);
  begin(out, jpeg_like_frame_ptr(0));
  run_ready();
  std::filesystem::remove(fifo_);
  const UniqueFd end = reader();
  ASSERT_TRUE(run_until_answered());
  EXPECT_EQ(log.lines("error robot session").size(), 1U);
}

TEST_F(PipeSinkTest, DropRecordsAreNoPartOfTheStream) {
  const UniqueFd end = reader();
  auto& out = fifo_sink(PipeFormat::kMjpeg);
  const DropRecord drop{7, 0, DropReason::kBusy};
  EXPECT_FALSE(write(out, ItemsPtr(std::make_shared<wire::Items>(
                              wire::Items{wire::kDrops, 0, wire::encode_drops({&drop, 1})}))));
  EXPECT_FALSE(write(out, jpeg_like_frame_ptr(0)));
  EXPECT_EQ(read(end, in_pipe(0).size()), in_pipe(0));
}

}  // namespace
}  // namespace orbbuf
