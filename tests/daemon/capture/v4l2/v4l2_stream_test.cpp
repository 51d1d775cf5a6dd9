// SPDX-License-Identifier: Apache-2.0
// What needs no camera; ./dev test-vm captures with those of a virtual machine.
#include "daemon/capture/v4l2/v4l2_stream.hpp"

#include <gmock/gmock.h>

#include "testing/temporary_folder.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;

std::string error(const std::filesystem::path& device) {
  SourceSettings settings;
  settings.device = device;
  return test::error_of([&] { open_v4l2_stream(settings); });
}

TEST(V4l2Stream, ACameraThatIsNotThereIsNamed) {
  EXPECT_THAT(
      error("/dev/video-none"),
      HasSubstr("cannot open camera /dev/video-none: No such file or directory; this machine has"));
}

TEST(V4l2Stream, WhatIsNoCameraIsRefused) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "file", "x");
  EXPECT_THAT(error(folder / "file"), HasSubstr("file: not a V4L2 device"));
  EXPECT_EQ(error("/dev/null"), "camera /dev/null: not a V4L2 device");
  EXPECT_THAT(error("/dev"), HasSubstr("cannot open camera /dev: Is a directory"));
}

}  // namespace
}  // namespace orbbuf
