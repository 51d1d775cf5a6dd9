// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <gmock/gmock.h>
#include <orbbuf/pipe.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#include <clocale>
#include <memory>
#include <thread>

#include "common/sample.hpp"
#include "common/unique_fd.hpp"
#include "server/sink/pipe/pipe_format.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::as_text;
using test::jpeg_frame_ptr;
using test::stereo_frame_ptr;

/// A reader of `stream`, which it holds.
class OrbbufPipeTest : public ::testing::Test {
 protected:
  ~OrbbufPipeTest() override { orbbuf_reader_free(&reader_); }
  void open(const std::string& stream) {
    stream_ = stream;
    file_.reset(::fmemopen(stream_.data(), stream_.size(), "rb"));
    orbbuf_reader_free(&reader_);
    orbbuf_reader_init(&reader_, file_.get());
  }
  int next() { return orbbuf_read(&reader_, &image_); }
  std::string data() const { return {image_.data, image_.data + image_.size}; }
  /// How reading ends, after `whole` whole images.
  std::string error(const std::string& stream, int whole = 0) {
    open(stream);
    for (int i = 0; i < whole; ++i) EXPECT_EQ(next(), 1);
    return next() == -1 ? reader_.error : "none";
  }

  orbbuf_reader reader_{};
  orbbuf_image image_{};

 private:
  struct Close {
    void operator()(FILE* file) const { std::fclose(file); }
  };
  std::string stream_;
  std::unique_ptr<FILE, Close> file_;
};

PipeNote note(const std::string& session) { return {session, 12, std::chrono::milliseconds(61)}; }

std::string pgm_of(const EncodedFrame& frame, const std::string& session = "s") {
  JpegCodec codec;
  return as_text(to_pgm(frame, note(session), codec).value());
}

std::string jpeg_of(const EncodedFrame& frame, const std::string& session = "s") {
  return as_text(to_mjpeg(frame, note(session)).value());
}

TEST_F(OrbbufPipeTest, ReadsThePgmsThatTheSinkWrites) {
  const auto mono = jpeg_frame_ptr(7, 31, 17);
  const auto pair = stereo_frame_ptr(jpeg_frame_ptr(8, 400, 300), jpeg_frame_ptr(9, 20, 10));
  open(pgm_of(*mono) + pgm_of(*pair));
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.format, ORBBUF_PGM);
  EXPECT_EQ(image_.seq, 7U);
  EXPECT_EQ(image_.t_ns, 7 * test::kFrameNs);
  EXPECT_DOUBLE_EQ(image_.t, 0.28);
  EXPECT_EQ(image_.missed, 12U);
  EXPECT_DOUBLE_EQ(image_.age, 0.061);
  EXPECT_EQ(image_.camera, ORBBUF_MONO);
  EXPECT_STREQ(image_.session, "s");
  EXPECT_EQ(image_.width, 31U);
  EXPECT_EQ(image_.height, 17U);
  JpegCodec codec;
  EXPECT_EQ(data(), as_text(codec.decode_gray(mono->left(), 1).value().pixels));
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.camera, ORBBUF_LEFT);
  EXPECT_EQ(image_.width, 400U);
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.camera, ORBBUF_RIGHT);
  EXPECT_EQ(image_.seq, 8U);
  EXPECT_EQ(image_.width, 20U);
  EXPECT_EQ(next(), 0);
}

TEST_F(OrbbufPipeTest, TellsTheQualityAndWhatAnImageWasReducedFrom) {
  EncodedFrame reduced = *jpeg_frame_ptr(8, 31, 17);
  reduced.quality = 30;
  reduced.whole_bytes = 4'000'000'000;
  EncodedFrame whole = *jpeg_frame_ptr(9, 31, 17);
  whole.quality = 100;
  for (const auto& of : {pgm_of, jpeg_of}) {
    open(of(*jpeg_frame_ptr(7, 31, 17), "s") + of(reduced, "s") + of(whole, "s"));
    for (const auto& [quality, whole_bytes] :
         {std::pair(0, 0U), std::pair(30, 4'000'000'000U), std::pair(100, 0U)}) {
      ASSERT_EQ(next(), 1);
      EXPECT_EQ(image_.quality, quality);
      EXPECT_EQ(image_.whole_bytes, whole_bytes);
    }
  }
}

TEST_F(OrbbufPipeTest, TellsTheSamplesBeforeAnImage) {
  constexpr int kSamples = 3000;  // several comments
  PipeNote with = note("s");
  for (int i = 0; i < kSamples; ++i) {
    const Sample sample{i, {i + 1e-17, -1.5, 0}, {0, 1.0 / 3, 9.81}};
    with.samples.push_back((i % 2 == 0 ? "imu0=" : "imu_left=") + to_euroc_line(sample));
  }
  const auto pair = stereo_frame_ptr(jpeg_frame_ptr(8, 40, 30), jpeg_frame_ptr(9, 20, 10));
  JpegCodec codec;
  for (const std::string& stream :
       {as_text(to_mjpeg(*pair, with).value()) + jpeg_of(*jpeg_frame_ptr(9, 20, 10)),
        as_text(to_pgm(*pair, with, codec).value()) + pgm_of(*jpeg_frame_ptr(9, 20, 10))}) {
    open(stream);
    ASSERT_EQ(next(), 1) << reader_.error;
    ASSERT_EQ(image_.sample_count, kSamples);
    const orbbuf_sample& last = image_.samples[kSamples - 1];
    EXPECT_STREQ(image_.samples[0].sensor, "imu0");
    EXPECT_STREQ(last.sensor, "imu_left");
    EXPECT_EQ(last.t_ns, kSamples - 1);
    EXPECT_EQ(last.angular_velocity[0], kSamples - 1 + 1e-17);
    EXPECT_EQ(last.angular_velocity[1], -1.5);
    EXPECT_EQ(last.linear_acceleration[1], 1.0 / 3);
    EXPECT_EQ(last.linear_acceleration[2], 9.81);
    for (int i = 0; i < 2; ++i) {  // the right image, and the next one
      ASSERT_EQ(next(), 1);
      EXPECT_EQ(image_.sample_count, 0U);
    }
  }
}

TEST_F(OrbbufPipeTest, NumbersHaveAPointInEveryLocale) {
  PipeNote with = note("s");
  with.age = std::chrono::milliseconds(1500);
  with.samples.emplace_back("imu0=1,0.25,2,3,4,5,-6.5e-3\n");
  if (std::setlocale(LC_NUMERIC, "de_DE.UTF-8") == nullptr) GTEST_SKIP() << "no such locale";
  open(as_text(to_mjpeg(*jpeg_frame_ptr(8, 40, 30), with).value()));
  const int got = next();
  std::setlocale(LC_NUMERIC, "C");
  ASSERT_EQ(got, 1) << reader_.error;
  EXPECT_EQ(image_.age, 1.5);
  EXPECT_EQ(image_.samples[0].angular_velocity[0], 0.25);
  EXPECT_EQ(image_.samples[0].linear_acceleration[2], -6.5e-3);
}

TEST_F(OrbbufPipeTest, ASampleThatIsNoneIsAnError) {
  for (const char* const sample : {"imu0=1,2,3,4,5,6\n", "imu0=1,2,3,4,5,6,x\n", "imu\n"}) {
    PipeNote with = note("s");
    with.samples.emplace_back(sample);
    EXPECT_THAT(error(as_text(to_mjpeg(*jpeg_frame_ptr(8, 40, 30), with).value())),
                testing::StartsWith("a sample has "));
  }
}

TEST_F(OrbbufPipeTest, ReadsTheJpegsThatTheSinkWrites) {
  EncodedFrame mono = *jpeg_frame_ptr(7, 333, 222);
  // A thumbnail, with an end of its own, within a segment that programs may ignore.
  const std::string thumbnail("\xFF\xE5\x00\x08\xFF\xD8..\xFF\xD9", 10);
  mono.jpeg.insert(mono.jpeg.begin() + 2, thumbnail.begin(), thumbnail.end());
  const EncodedFrame pair =
      *stereo_frame_ptr(jpeg_frame_ptr(8, 400, 300), jpeg_frame_ptr(9, 20, 10));
  const std::string both = jpeg_of(pair);
  open(jpeg_of(mono) + both);
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.format, ORBBUF_JPEG);
  EXPECT_EQ(image_.seq, 7U);
  EXPECT_EQ(image_.t_ns, 7 * test::kFrameNs);
  EXPECT_EQ(image_.camera, ORBBUF_MONO);
  EXPECT_STREQ(image_.session, "s");
  EXPECT_EQ(data(), jpeg_of(mono));
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.camera, ORBBUF_LEFT);
  const std::string left = data();
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.camera, ORBBUF_RIGHT);
  EXPECT_EQ(image_.seq, 8U);
  EXPECT_EQ(left + data(), both);
  EXPECT_EQ(next(), 0);
}

TEST_F(OrbbufPipeTest, NoImageOfASessionIsGivenTwice) {
  const auto one = pgm_of(*jpeg_frame_ptr(1, 8, 8));
  const auto pair = pgm_of(*stereo_frame_ptr(jpeg_frame_ptr(2, 8, 8), jpeg_frame_ptr(2, 8, 8)));
  open(one + one + pair.substr(0, pair.size() / 2) + pair + one +
       pgm_of(*jpeg_frame_ptr(0, 8, 8), "t"));
  ASSERT_EQ(next(), 1);
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.seq, 2U);
  EXPECT_EQ(image_.camera, ORBBUF_LEFT);
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.seq, 2U);
  EXPECT_EQ(image_.camera, ORBBUF_RIGHT);
  ASSERT_EQ(next(), 1);  // another session
  EXPECT_EQ(image_.seq, 0U);
  EXPECT_EQ(next(), 0);
}

TEST_F(OrbbufPipeTest, TimesBeforeTheEpochAreNegative) {
  open("P5\n# seq=1\n# t=-1.500000000\n# session=s\n1 1\n255\nx");
  ASSERT_EQ(next(), 1);
  EXPECT_EQ(image_.t_ns, -1'500'000'000);
}

TEST_F(OrbbufPipeTest, UnknownCommentsArePassedOver) {
  open("P5\n# seq=1\n#\n# of tomorrow\n# t=1.000000000\n# session=s\n1 1\n255\nx");
  EXPECT_EQ(next(), 1);
}

TEST_F(OrbbufPipeTest, WhatIsNoPgmIsAnErrorThatSaysWhy) {
  const std::string head = "P5\n# seq=1\n# t=1.000000000\n# session=s\n";
  EXPECT_EQ(error(head + "2 2\n255\nabcd!", 1), "this is not where an image begins");
  EXPECT_EQ(error("P6\n"), "this is not where an image begins");
  EXPECT_EQ(error(head + "2 2\n255\nabc"), "the stream ends in an image");
  EXPECT_EQ(error(head), "the stream ends in an image");
  EXPECT_EQ(error("P5\n# seq=1\n# t=1.5\n1 1\n255\nx"), "the time is none");
  for (const char* told :
       {"# seq=1\n# t=1.000000000\n", "# seq=1\n# session=s\n", "# t=1.000000000\n# session=s\n"}) {
    EXPECT_EQ(error("P5\n" + std::string(told) + "1 1\n255\nx"),
              "the image has no seq, no t or no session");
  }
  EXPECT_EQ(error(head + "0 2\n255\n"), "the image has no size");
  EXPECT_EQ(error(head + "70000 2\n255\n"), "the image has no size");
  EXPECT_EQ(error(head + "1 1\n65535\nxx"), "the image has not 8 bits a pixel");
  EXPECT_EQ(error(head + "65535 65535\n255\n"), "the image is larger than ORBBUF_MAX_IMAGE");
  EXPECT_EQ(error(head + std::string(400, '#') + "\n"), "a line of the head is too long");
}

TEST_F(OrbbufPipeTest, WhatIsNoJpegIsAnErrorThatSaysWhy) {
  const auto frame = jpeg_frame_ptr(1, 64, 64);
  EXPECT_EQ(error(as_text(frame->jpeg)), "this is not where an image begins");
  EXPECT_EQ(error("GIF8"), "this is not where an image begins");
  const std::string jpeg = jpeg_of(*frame);
  const std::size_t head = jpeg.find("session=s\n") + 10;
  EXPECT_EQ(error(jpeg.substr(0, head) + "zz"), "a JPEG marker is missing");
  EXPECT_EQ(error(jpeg.substr(0, head) + std::string("\xFF\xE0\x00\x01", 4)),
            "a JPEG segment has no length");
  EXPECT_EQ(error(std::string("\xFF\xD8\xFF\xFE\x01\x92", 6) + std::string(400, 'x')),
            "a line of the head is too long");
  EXPECT_EQ(error(std::string("\xFF\xD8\xFF\xFE\x00\x04x\n", 8)),
            "the image has no seq, no t or no session");
  for (std::size_t size = 1; size < jpeg.size(); ++size) {
    EXPECT_NE(error(jpeg.substr(0, size)), "none") << size;
  }
}

TEST_F(OrbbufPipeTest, AFifoIsFollowedPastItsWritersEnds) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "fifo";
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  const auto images = [](Sequence first, Sequence last) {
    std::string all;
    for (Sequence i = first; i <= last; ++i) all += jpeg_of(*jpeg_frame_ptr(i, 64, 64));
    return all;
  };
  const UniqueFd watch(::inotify_init1(IN_CLOEXEC));
  ASSERT_GE(::inotify_add_watch(watch.get(), path.c_str(), IN_CLOSE_NOWRITE), 0);
  std::jthread writers([&] {
    // The second breaks off in an image, the third begins with a repeat of what was whole.
    for (const auto& stream :
         {images(0, 1), images(2, 3) + images(4, 4).substr(0, 50), images(3, 6)}) {
      test::write_file(path, stream);
      // The reader must see this end: a writer that comes at once would not be told from this one.
      inotify_event reader_closed{};
      EXPECT_GT(::read(watch.get(), &reader_closed, sizeof(reader_closed)), 0);
    }
    test::write_file(path, images(7, 7));
  });
  ASSERT_EQ(orbbuf_reader_follow(&reader_, path.c_str()), 0);
  for (Sequence i = 0; i <= 7; ++i) {
    ASSERT_EQ(next(), 1) << reader_.error;
    EXPECT_EQ(image_.seq, i);
  }
}

TEST_F(OrbbufPipeTest, WhatIsNoFifoIsNotFollowed) {
  const test::TemporaryFolder folder;
  const std::string file = folder / "file";
  EXPECT_EQ(orbbuf_reader_follow(&reader_, file.c_str()), -1);
  EXPECT_STREQ(reader_.error, "the FIFO cannot be opened");
  test::write_file(folder / "file", jpeg_of(*jpeg_frame_ptr(0, 64, 64)));
  EXPECT_EQ(orbbuf_reader_follow(&reader_, file.c_str()), -1);
  EXPECT_STREQ(reader_.error, "the path is no FIFO");
  EXPECT_EQ(next(), -1);
}

}  // namespace
}  // namespace orbbuf
