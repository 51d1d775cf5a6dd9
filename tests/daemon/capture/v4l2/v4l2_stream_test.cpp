// SPDX-License-Identifier: Apache-2.0
// What needs no camera; ./dev test-vm captures with those of a virtual machine.
#include "daemon/capture/v4l2/v4l2_stream.hpp"

#include <gmock/gmock.h>

#include "daemon/capture/v4l2/v4l2_device.hpp"
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

TEST(V4l2Stream, TheUsbPortOfANodeIsFoundAlsoByALinkToTheNode) {
  namespace fs = std::filesystem;
  const test::TemporaryFolder folder;
  const fs::path port = folder / "devices/usb1/1-1.2";
  fs::create_directories(port / "1-1.2:1.0");
  test::write_file(port / "authorized", "1");
  fs::create_directories(folder / "class/video4linux/video7");
  fs::create_directory_symlink(port / "1-1.2:1.0", folder / "class/video4linux/video7/device");
  test::write_file(folder / "video7", "");
  fs::create_symlink("video7", folder / "by-id");
  for (const char* node : {"video7", "by-id"}) {
    EXPECT_EQ(usb_reset_command(folder / node, folder.path()),
              "for i in 0 1; do echo $i | sudo tee " + fs::canonical(port).string() +
                  "/authorized; done");
  }
  fs::remove(port / "authorized");  // a camera of the board
  EXPECT_EQ(usb_reset_command(folder / "video7", folder.path()), "");
  EXPECT_EQ(usb_reset_command("/dev/video-none", folder.path()), "");
}

}  // namespace
}  // namespace orbbuf
