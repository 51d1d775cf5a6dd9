// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/libcamera/libcamera_planes.hpp"

#include <libcamera/framebuffer.h>
#include <linux/dma-buf.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <cerrno>

namespace orbbuf {

using libcamera::FrameBuffer;

LibcameraPlanes::LibcameraPlanes(const FrameBuffer& buffer, bool color) : buffer_(buffer) {
  for (const FrameBuffer::Plane& plane : buffer.planes()) {
    mappings_.emplace_back(plane.fd.get(), 0, std::size_t{plane.offset} + plane.length);
    if (!mappings_.back() || !color) break;
  }
}

LibcameraPlanes::operator bool() const {
  return !mappings_.empty() && static_cast<bool>(mappings_.back());
}

std::span<const std::uint8_t> LibcameraPlanes::filled(std::size_t plane,
                                                      std::size_t bytes_used) const {
  if (plane >= mappings_.size()) return {};
  const auto memory = mappings_[plane].bytes().subspan(buffer_.planes()[plane].offset);
  return memory.first(std::min(bytes_used, memory.size()));
}

void LibcameraPlanes::begin_reading() const { synchronise(DMA_BUF_SYNC_START); }

void LibcameraPlanes::end_reading() const { synchronise(DMA_BUF_SYNC_END); }

void LibcameraPlanes::synchronise(std::uint64_t moment) const {
  dma_buf_sync sync{};
  sync.flags = DMA_BUF_SYNC_READ | moment;
  for (std::size_t i = 0; i < mappings_.size(); ++i) {
    const int fd = buffer_.planes()[i].fd.get();
    while (::ioctl(fd, DMA_BUF_IOCTL_SYNC, &sync) != 0 && (errno == EINTR || errno == EAGAIN)) {
    }
  }
}

}  // namespace orbbuf
