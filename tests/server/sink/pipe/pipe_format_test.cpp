// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/pipe_format.hpp"

#include <gtest/gtest.h>

#include "testing/restart_jpeg.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::as_text;
using test::jpeg_frame_ptr;
using test::stereo_frame_ptr;

const PipeNote kNote{"s1", 0, std::chrono::microseconds(61'499)};

/// `jpeg` with a comment segment that says `lines` after its first marker.
std::string with_comment(std::span<const std::uint8_t> jpeg, const std::string& lines) {
  const auto length = static_cast<char>(lines.size() + 2);
  return "\xFF\xD8\xFF\xFE" + std::string{'\0', length} + lines + as_text(jpeg.subspan(2));
}

TEST(PipeFormat, AJpegTellsItsFrameInACommentAndIsElseUntouched) {
  const auto frame = jpeg_frame_ptr(41, 24, 10);
  EXPECT_EQ(as_text(to_mjpeg(*frame, kNote).value()),
            with_comment(frame->jpeg, "seq=41\nt=1.640000000\nage=0.061\nsession=s1\n"));
}

TEST(PipeFormat, TheJpegsOfAStereoFrameTellTheirCamera) {
  const auto frame = stereo_frame_ptr(jpeg_frame_ptr(41, 24, 10), jpeg_frame_ptr(42, 24, 10));
  EXPECT_EQ(
      as_text(to_mjpeg(*frame, kNote).value()),
      with_comment(frame->left(), "seq=41\nt=1.640000000\ncamera=left\nage=0.061\nsession=s1\n") +
          with_comment(frame->right(),
                       "seq=41\nt=1.640000000\ncamera=right\nage=0.061\nsession=s1\n"));
}

TEST(PipeFormat, AnImageTellsHowManyFramesWereMissedBeforeIt) {
  const auto frame = jpeg_frame_ptr(41, 24, 10);
  const PipeNote note{"s1", 12, std::chrono::milliseconds(-2)};
  const std::string lines = "seq=41\nt=1.640000000\nmissed=12\nage=-0.002\nsession=s1\n";
  EXPECT_EQ(as_text(to_mjpeg(*frame, note).value()), with_comment(frame->jpeg, lines));
}

TEST(PipeFormat, AnImageTellsItsQualityAndWhatItWasReducedFrom) {
  EncodedFrame frame = *jpeg_frame_ptr(41, 24, 10);
  frame.quality = 80;
  const std::string begin = "seq=41\nt=1.640000000\n";
  const std::string end = "age=0.061\nsession=s1\n";
  EXPECT_EQ(as_text(to_mjpeg(frame, kNote).value()),
            with_comment(frame.jpeg, begin + "quality=80\n" + end));
  frame.quality = 30;
  frame.whole_bytes = 40'123;
  EXPECT_EQ(as_text(to_mjpeg(frame, kNote).value()),
            with_comment(frame.jpeg, begin + "quality=30\nwhole=40123\n" + end));
}

TEST(PipeFormat, AJpegWithItsCommentDecodesToTheSamePixels) {
  const auto frame = jpeg_frame_ptr(3, 64, 48);
  JpegCodec codec;
  EXPECT_EQ(codec.decode_gray(to_mjpeg(*frame, kNote).value(), 1).value().pixels,
            codec.decode_gray(frame->jpeg, 1).value().pixels);
}

TEST(PipeFormat, ZerosBehindAJpegAreDropped) {
  EncodedFrame frame = *jpeg_frame_ptr(1, 16, 16);
  const auto exact = to_mjpeg(frame, kNote).value();
  frame.jpeg.resize(frame.jpeg.size() + 100);
  EXPECT_EQ(to_mjpeg(frame, kNote).value(), exact);
}

TEST(PipeFormat, PgmIsMadeOfAJpegWithSpareBytesBeforeRestartMarkers) {
  const auto frame = [](std::size_t spare) {
    return test::frame_of(41, test::restart_jpeg(64, 48, true, spare));
  };
  JpegCodec codec;
  const auto pgm = to_pgm(frame(3), kNote, codec);
  ASSERT_TRUE(pgm) << pgm.error().text;
  EXPECT_EQ(pgm.value(), to_pgm(frame(0), kNote, codec).value());
  EXPECT_EQ(codec.repaired(), 1U);
}

TEST(PipeFormat, WhatIsNoJpegIsAnErrorAndNotWritten) {
  EncodedFrame frame = *jpeg_frame_ptr(1, 16, 16);
  frame.jpeg.pop_back();
  EXPECT_EQ(to_mjpeg(frame, kNote).error().text, "it does not begin and end as a JPEG does");
  frame.jpeg.assign(1000, 0);
  EXPECT_FALSE(to_mjpeg(frame, kNote));
  JpegCodec codec;
  EXPECT_FALSE(to_pgm(frame, kNote, codec));
}

}  // namespace
}  // namespace orbbuf
