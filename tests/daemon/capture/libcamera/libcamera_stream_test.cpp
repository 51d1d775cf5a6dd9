// SPDX-License-Identifier: Apache-2.0
// What needs no camera; ./dev test-vm captures with one of a virtual machine.
#include "daemon/capture/libcamera/libcamera_stream.hpp"

#include <gmock/gmock.h>

#include "daemon/capture/libcamera/libcamera_manager.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;

TEST(LibcameraStream, ACameraThatIsNotThereIsNamed) {
  for (const char* camera : {"no such camera", "", "999", "99999999999999999999"}) {
    SourceSettings settings;
    settings.camera = camera;
    EXPECT_THAT(
        test::error_of([&] { open_libcamera_stream(settings); }),
        HasSubstr(std::string("libcamera has no camera ") + camera + ": it found no camera"));
  }
}

TEST(LibcameraManager, IsSharedAndBegunAnewAfterTheLast) {
  auto first = libcamera_manager();
  EXPECT_EQ(libcamera_manager(), first);
  const std::weak_ptr<libcamera::CameraManager> watch = first;
  first.reset();
  EXPECT_TRUE(watch.expired());
  EXPECT_TRUE(libcamera_manager());
}

}  // namespace
}  // namespace orbbuf
