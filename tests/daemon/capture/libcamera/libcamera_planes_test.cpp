// SPDX-License-Identifier: Apache-2.0
// Buffers as the pipeline of a Raspberry Pi 2 to 4 gives them: one descriptor for all planes, rows
// padded.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <libcamera/framebuffer.h>
#include <linux/dma-buf.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <numeric>

#include "daemon/capture/camera_unpack.hpp"
#include "daemon/capture/libcamera/libcamera_stream.hpp"

namespace orbbuf {
namespace {

using libcamera::FrameBuffer;
using testing::ElementsAre;

using Bytes = std::vector<std::uint8_t>;

/// How a DMA buffer was told of reading, of all descriptors in order; there is none on most
/// machines.
struct Synced {
  int fd;
  std::uint64_t flags;
  bool operator==(const Synced&) const = default;
};
std::vector<Synced> synced;
std::vector<int> refusals;  // errors of the next calls

/// The library's call; a failure sets errno.
int synchronise(int fd, const dma_buf_sync& sync) {
  synced.push_back({fd, sync.flags});
  if (refusals.empty()) return 0;
  errno = refusals.back();
  refusals.pop_back();
  return -1;
}

}  // namespace
}  // namespace orbbuf

// In place of the C library's, for this program.
extern "C" int ioctl(int fd, unsigned long request, ...) noexcept {
  va_list arguments;
  va_start(arguments, request);
  void* const argument = va_arg(arguments, void*);
  va_end(arguments);
  if (request == DMA_BUF_IOCTL_SYNC) {
    return orbbuf::synchronise(fd, *static_cast<const dma_buf_sync*>(argument));
  }
  return static_cast<int>(::syscall(SYS_ioctl, fd, request, argument));
}

namespace orbbuf {
namespace {

constexpr int kWidth = 6, kHeight = 4;
constexpr unsigned kStride = 8;
constexpr unsigned kLuma = kStride * kHeight, kChroma = kLuma / 4;

/// A descriptor of memory that contains `bytes`.
libcamera::SharedFD memory_of(const Bytes& bytes) {
  const int fd = ::memfd_create("planes", MFD_CLOEXEC);
  EXPECT_EQ(::write(fd, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  libcamera::SharedFD shared(fd);
  ::close(fd);
  return shared;
}

Bytes counting(std::size_t size) {
  Bytes bytes(size);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  return bytes;
}

/// Planes of these sizes, one behind the other in one descriptor, whose bytes count from 0.
FrameBuffer in_one_descriptor(const std::vector<unsigned>& sizes) {
  const auto fd = memory_of(counting(std::accumulate(sizes.begin(), sizes.end(), 0U)));
  std::vector<FrameBuffer::Plane> planes;
  unsigned offset = 0;
  for (const unsigned size : sizes) {
    FrameBuffer::Plane& plane = planes.emplace_back();
    plane.fd = fd;
    plane.offset = offset;
    plane.length = size;
    offset += size;
  }
  return FrameBuffer(planes);
}

Bytes unpacked(const LibcameraPlanes& planes, CameraFormat format, bool color) {
  const CameraMode mode = {.format = format,
                           .width_px = kWidth,
                           .height_px = kHeight,
                           .stride_bytes = kStride,
                           .color = color};
  planes.begin_reading();
  const RawFrame frame =
      unpack(mode, planes.filled(0, kLuma), {planes.filled(1, kLuma), planes.filled(2, kLuma)});
  planes.end_reading();
  EXPECT_EQ(frame.defect, "");
  return {frame.data.begin(), frame.data.end()};
}

/// The luma without its padding: 0 to 5, 8 to 13, ...
Bytes luma() {
  Bytes bytes;
  for (unsigned y = 0; y < kHeight; ++y) {
    for (unsigned x = 0; x < kWidth; ++x) {
      bytes.push_back(static_cast<std::uint8_t>(y * kStride + x));
    }
  }
  return bytes;
}

TEST(LibcameraPlanes, PaddedYuv420InOneDescriptorIsReadWithItsChroma) {
  const FrameBuffer buffer = in_one_descriptor({kLuma, kChroma, kChroma});
  const LibcameraPlanes planes(buffer, true);
  ASSERT_TRUE(planes);
  Bytes expected = luma();
  for (const int first : {32, 36, 40, 44}) {  // two rows of blue, two of red, each 3 of 4 bytes
    for (int x = 0; x < 3; ++x) expected.push_back(static_cast<std::uint8_t>(first + x));
  }
  EXPECT_EQ(unpacked(planes, CameraFormat::kYuv420, true), expected);
}

TEST(LibcameraPlanes, PaddedNv12InOneDescriptorIsReadWithItsChroma) {
  const FrameBuffer buffer = in_one_descriptor({kLuma, 2 * kChroma});
  const LibcameraPlanes planes(buffer, true);
  ASSERT_TRUE(planes);
  Bytes expected = luma();
  for (const int blue : {32, 34, 36, 40, 42, 44})
    expected.push_back(static_cast<std::uint8_t>(blue));
  for (const int red : {33, 35, 37, 41, 43, 45}) expected.push_back(static_cast<std::uint8_t>(red));
  EXPECT_EQ(unpacked(planes, CameraFormat::kNv12, true), expected);
}

TEST(LibcameraPlanes, InGrayOnlyTheFirstPlaneIsMapped) {
  const FrameBuffer buffer = in_one_descriptor({kLuma, kChroma, kChroma});
  const LibcameraPlanes planes(buffer, false);
  ASSERT_TRUE(planes);
  EXPECT_EQ(unpacked(planes, CameraFormat::kYuv420, false), luma());
  EXPECT_TRUE(planes.filled(1, kChroma).empty());
}

TEST(LibcameraPlanes, EachPlaneMayHaveADescriptorOfItsOwn) {
  std::vector<FrameBuffer::Plane> of(2);
  of[0].fd = memory_of({1, 2, 3, 4});
  of[1].fd = memory_of({0, 0, 7, 8});
  of[0].offset = 0;
  of[1].offset = 2;
  of[0].length = 4;
  of[1].length = 2;
  const FrameBuffer buffer(of);
  const LibcameraPlanes planes(buffer, true);
  ASSERT_TRUE(planes);
  EXPECT_THAT(planes.filled(0, 4), ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(planes.filled(1, 2), ElementsAre(7, 8));
}

TEST(LibcameraPlanes, NoMoreIsReadThanWasFilledNorThanThereIs) {
  const FrameBuffer buffer = in_one_descriptor({4, 2});
  const LibcameraPlanes planes(buffer, true);
  EXPECT_THAT(planes.filled(0, 3), ElementsAre(0, 1, 2));
  EXPECT_THAT(planes.filled(0, 0), ElementsAre());
  EXPECT_THAT(planes.filled(1, 100), ElementsAre(4, 5));
  EXPECT_TRUE(planes.filled(2, 1).empty());
}

TEST(LibcameraPlanes, TheCacheIsToldBeforeAndAfterReading) {
  const FrameBuffer buffer = in_one_descriptor({kLuma, kChroma, kChroma});
  const LibcameraPlanes gray(buffer, false);
  const int fd = buffer.planes()[0].fd.get();
  synced.clear();
  gray.begin_reading();
  EXPECT_THAT(synced, ElementsAre(Synced{fd, DMA_BUF_SYNC_READ | DMA_BUF_SYNC_START}));
  gray.end_reading();
  EXPECT_THAT(synced, ElementsAre(testing::_, Synced{fd, DMA_BUF_SYNC_READ | DMA_BUF_SYNC_END}));
}

TEST(LibcameraPlanes, EveryDescriptorIsSynchronised) {
  std::vector<FrameBuffer::Plane> of(2);
  for (auto& plane : of) {
    plane.fd = memory_of({1, 2, 3, 4});
    plane.offset = 0;
    plane.length = 4;
  }
  const FrameBuffer buffer(of);
  const LibcameraPlanes planes(buffer, true);
  synced.clear();
  planes.begin_reading();
  ASSERT_EQ(synced.size(), 2U);
  EXPECT_EQ(synced[0].fd, buffer.planes()[0].fd.get());
  EXPECT_EQ(synced[1].fd, buffer.planes()[1].fd.get());
}

TEST(LibcameraPlanes, AnInterruptedSynchronisationIsRepeatedAndAFailedOneIsNot) {
  const FrameBuffer buffer = in_one_descriptor({4});
  const LibcameraPlanes planes(buffer, false);
  synced.clear();
  refusals = {ENOTTY, EAGAIN, EINTR};
  planes.begin_reading();
  EXPECT_EQ(synced.size(), 3U);
  EXPECT_TRUE(refusals.empty());
}

TEST(LibcameraPlanes, MemoryThatCannotBeMappedIsNoticed) {
  std::vector<FrameBuffer::Plane> of(1);
  of[0].fd = libcamera::SharedFD(::open("/dev/null", O_WRONLY | O_CLOEXEC));
  of[0].offset = 0;
  of[0].length = 4;
  const FrameBuffer buffer(of);
  const LibcameraPlanes planes(buffer, true);
  EXPECT_FALSE(planes);
  EXPECT_EQ(errno, EACCES);
}

}  // namespace
}  // namespace orbbuf
