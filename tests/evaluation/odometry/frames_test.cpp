// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/frames.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

namespace orbbuf::evaluation {
namespace {

/// A pipe's bytes, all of them there.
std::unique_ptr<std::FILE, int (*)(std::FILE*)> piped(std::string& bytes) {
  return {::fmemopen(bytes.data(), bytes.size(), "r"), std::fclose};
}

TEST(Pipe, IsReadAsTheServerWritesIt) {
  std::string bytes =
      "P5\n# seq=7\n# t=12.500000000\n# session=s\n# camera=left\n2 1\n255\nab"
      "P5\n# seq=7\n# t=12.500000000\n# session=s\n# camera=right\n2 1\n255\n#d";
  const auto in = piped(bytes);
  Pipe pipe(in.get());
  const auto next = pipe.next(true);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->id, 7U);
  EXPECT_EQ(next->frame.time_s, 12.5);
  EXPECT_EQ(next->frame.left.at<uchar>(0, 1), 'b');
  EXPECT_EQ(next->frame.right.at<uchar>(0, 0), '#');
  EXPECT_FALSE(pipe.next(true));
}

TEST(Pipe, CutShortIsAnError) {
  std::string bytes = "P5\n# seq=0\n# t=1.000000000\n# session=s\n2 1\n255\na";
  const auto in = piped(bytes);
  EXPECT_THROW(Pipe(in.get()).next(false), std::runtime_error);
}

TEST(Pipe, OfOneCameraIsNotStereo) {
  std::string bytes = "P5\n# seq=0\n# t=1.000000000\n# session=s\n1 1\n255\na";
  const auto in = piped(bytes);
  EXPECT_THROW(Pipe(in.get()).next(true), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::evaluation
