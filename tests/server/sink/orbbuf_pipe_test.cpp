// SPDX-License-Identifier: Apache-2.0
#include "server/sink/orbbuf_pipe.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "server/sink/pipe_sink.hpp"
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
  int next_jpeg() { return orbbuf_read_jpeg(&reader_, &jpeg_, &size_); }
  /// How reading ends, after `whole` whole images.
  std::string pgm_error(const std::string& stream, int whole = 0) {
    open(stream);
    orbbuf_image image;
    for (int i = 0; i < whole; ++i) EXPECT_EQ(orbbuf_read_pgm(&reader_, &image), 1);
    return orbbuf_read_pgm(&reader_, &image) == -1 ? reader_.error : "none";
  }
  std::string jpeg_error(const std::string& stream) {
    open(stream);
    return next_jpeg() == -1 ? reader_.error : "none";
  }

  orbbuf_reader reader_{};
  const std::uint8_t* jpeg_ = nullptr;
  std::size_t size_ = 0;

 private:
  struct Close {
    void operator()(FILE* file) const { std::fclose(file); }
  };
  std::string stream_;
  std::unique_ptr<FILE, Close> file_;
};

std::string pgm_of(const EncodedFrame& frame) {
  JpegCodec codec;
  return as_text(to_pgm(frame, codec).value());
}

TEST_F(OrbbufPipeTest, ReadsWhatTheSinkWrites) {
  const auto mono = jpeg_frame_ptr(7, 31, 17);
  const auto pair = stereo_frame_ptr(jpeg_frame_ptr(8, 400, 300), jpeg_frame_ptr(9, 20, 10));
  open(pgm_of(*mono) + pgm_of(*pair));
  orbbuf_image image;
  ASSERT_EQ(orbbuf_read_pgm(&reader_, &image), 1);
  EXPECT_EQ(image.seq, 7U);
  EXPECT_EQ(image.t_ns, 7 * test::kFrameNs);
  EXPECT_DOUBLE_EQ(image.t, 0.28);
  EXPECT_EQ(image.camera, ORBBUF_MONO);
  EXPECT_EQ(image.width, 31U);
  EXPECT_EQ(image.height, 17U);
  JpegCodec codec;
  const auto decoded = codec.decode_gray(mono->left(), 1);
  EXPECT_TRUE(
      std::equal(decoded.value().pixels.begin(), decoded.value().pixels.end(), image.pixels));
  ASSERT_EQ(orbbuf_read_pgm(&reader_, &image), 1);
  EXPECT_EQ(image.camera, ORBBUF_LEFT);
  EXPECT_EQ(image.width, 400U);
  ASSERT_EQ(orbbuf_read_pgm(&reader_, &image), 1);
  EXPECT_EQ(image.camera, ORBBUF_RIGHT);
  EXPECT_EQ(image.seq, 8U);
  EXPECT_EQ(image.width, 20U);
  EXPECT_EQ(orbbuf_read_pgm(&reader_, &image), 0);
}

TEST_F(OrbbufPipeTest, TimesBeforeTheEpochAreNegative) {
  open("P5\n# seq=1\n# t=-1.500000000\n1 1\n255\nx");
  orbbuf_image image;
  ASSERT_EQ(orbbuf_read_pgm(&reader_, &image), 1);
  EXPECT_EQ(image.t_ns, -1'500'000'000);
}

TEST_F(OrbbufPipeTest, UnknownCommentsArePassedOver) {
  open("P5\n# seq=1\n# of tomorrow\n# t=1.000000000\n1 1\n255\nx");
  orbbuf_image image;
  EXPECT_EQ(orbbuf_read_pgm(&reader_, &image), 1);
}

TEST_F(OrbbufPipeTest, WhatIsNoPgmIsAnErrorThatSaysWhy) {
  const std::string head = "P5\n# seq=1\n# t=1.000000000\n";
  EXPECT_EQ(pgm_error(head + "2 2\n255\nabcd!", 1), "this is not where a PGM image begins");
  EXPECT_EQ(pgm_error(head + "2 2\n255\nabc"), "the stream ends in an image");
  EXPECT_EQ(pgm_error(head), "the stream ends in an image");
  EXPECT_EQ(pgm_error("P5\n# seq=1\n# t=1.5\n1 1\n255\nx"), "the time is none");
  EXPECT_EQ(pgm_error("P5\n# seq=1\n1 1\n255\nx"), "the image has no seq or no t");
  EXPECT_EQ(pgm_error(head + "0 2\n255\n"), "the image has no size");
  EXPECT_EQ(pgm_error(head + "70000 2\n255\n"), "the image has no size");
  EXPECT_EQ(pgm_error(head + "1 1\n65535\nxx"), "the image has not 8 bits a pixel");
  EXPECT_EQ(pgm_error(head + "65535 65535\n255\n"), "the image is larger than ORBBUF_MAX_IMAGE");
  EXPECT_EQ(pgm_error(head + std::string(200, '#') + "\n"), "a line of the head is too long");
}

TEST_F(OrbbufPipeTest, JpegsComeApartAgain) {
  const auto first = as_text(jpeg_frame_ptr(1, 333, 222)->jpeg);
  auto second = as_text(jpeg_frame_ptr(2, 16, 16)->jpeg);
  // A thumbnail, with an end of its own, within a segment that programs may ignore.
  second.insert(2, std::string("\xFF\xE5\x00\x08\xFF\xD8..\xFF\xD9", 10));
  open(first + second);
  ASSERT_EQ(next_jpeg(), 1);
  EXPECT_EQ(as_text({jpeg_, size_}), first);
  ASSERT_EQ(next_jpeg(), 1);
  EXPECT_EQ(as_text({jpeg_, size_}), second);
  EXPECT_EQ(next_jpeg(), 0);
}

TEST_F(OrbbufPipeTest, WhatIsNoJpegIsAnErrorThatSaysWhy) {
  const auto jpeg = as_text(jpeg_frame_ptr(1, 64, 64)->jpeg);
  EXPECT_EQ(jpeg_error("P5\n"), "this is not where a JPEG image begins");
  EXPECT_EQ(jpeg_error("\xFF\xD8zz"), "a JPEG marker is missing");
  EXPECT_EQ(jpeg_error(std::string("\xFF\xD8\xFF\xE0\x00\x01", 6)), "a JPEG segment has no length");
  for (std::size_t size = 1; size < jpeg.size(); ++size) {
    EXPECT_NE(jpeg_error(jpeg.substr(0, size)), "none") << size;
  }
}

}  // namespace
}  // namespace orbbuf
