// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/libcamera/libcamera_stream.hpp"

#include <fmt/core.h>
#include <libcamera/framebuffer.h>
#include <libcamera/libcamera.h>
#include <linux/dma-buf.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <cerrno>
#include <deque>
#include <limits>
#include <mutex>
#include <stdexcept>

#include "common/event_fd.hpp"
#include "daemon/capture/libcamera/libcamera_controls.hpp"
#include "daemon/capture/libcamera/libcamera_formats.hpp"
#include "daemon/capture/libcamera/libcamera_manager.hpp"
// Compiles with libcamera 0.0.3 (Debian 12) to 0.7. What differs and is used here: whether a
// control takes an array (libcamera_controls.cpp), strings that are views, planes that come in a
// Span, and FrameStartup, unknown to old releases: an image like others.

namespace orbbuf {
namespace {

using libcamera::FrameBuffer;
using libcamera::Request;

constexpr std::size_t kLeastRequests = 3;  // one lent, two with the camera

std::string_view hint_at_camera(int error) {
  if (error == EBUSY) return "; another program uses the camera";
  return error == EACCES ? "; add the user to group video" : "";
}

/// The part of a plane that was filled; empty if there is no such plane.
std::span<const std::uint8_t> filled(const FrameBuffer& buffer, const LibcameraPlanes& planes,
                                     std::size_t plane) {
  const auto filled_planes = buffer.metadata().planes();
  if (plane >= filled_planes.size()) return {};
  return planes.filled(plane, filled_planes[plane].bytesused);
}

std::uint32_t exposure_ns_of(const libcamera::ControlList& metadata) {
  const std::int64_t exposure_us = metadata.get(libcamera::controls::ExposureTime).value_or(0);
  const std::int64_t most_us = std::numeric_limits<std::uint32_t>::max() / 1000;
  return static_cast<std::uint32_t>(std::clamp<std::int64_t>(exposure_us, 0, most_us)) * 1000;
}

/// What libcamera calls the time since booting is its drivers' monotonic time.
std::int64_t stamp_ns_of(const libcamera::ControlList& metadata,
                         const libcamera::FrameMetadata& frame) {
  return metadata.get(libcamera::controls::SensorTimestamp)
      .value_or(static_cast<std::int64_t>(frame.timestamp));
}

/// One libcamera camera, from its acquisition to its release.
class LibcameraStream final : public CameraStream {
 public:
  explicit LibcameraStream(const std::string& camera)
      : manager_(libcamera_manager()),
        camera_(find_libcamera(*manager_, camera)),
        event_(make_event_fd()) {}
  ~LibcameraStream() override;

  void start(const SourceSettings& settings);

  int fd() const override { return event_.get(); }
  const CameraMode& mode() const override { return setup_.mode; }
  std::string description() const override;
  Result<std::optional<CameraBuffer>> borrow() override;
  std::optional<Error> give_back(const CameraBuffer& buffer) override;

 private:
  void make_requests();
  CameraBuffer lend(Request& request);
  void completed(Request* request);
  void disconnected();
  void must(std::string_view attempt, int status) const;

  std::shared_ptr<libcamera::CameraManager> manager_;
  std::shared_ptr<libcamera::Camera> camera_;
  bool is_acquired_ = false;
  LibcameraSetup setup_;
  std::unique_ptr<libcamera::FrameBufferAllocator> allocator_;
  std::vector<LibcameraPlanes> planes_;
  std::vector<std::unique_ptr<Request>> requests_;  // each with the buffer of its place

  UniqueFd event_;  // readable while something is in one of these, which libcamera's thread fills
  std::mutex mutex_;
  std::deque<Request*> ready_;
  std::string failure_;
};

LibcameraStream::~LibcameraStream() {
  camera_->stop();  // all that was queued comes back; does nothing to an unplugged camera
  camera_->requestCompleted.disconnect(this);
  camera_->disconnected.disconnect(this);
  requests_.clear();
  planes_.clear();
  allocator_.reset();
  if (is_acquired_) camera_->release();
}

void LibcameraStream::must(std::string_view attempt, int status) const {
  if (status >= 0) return;
  const auto text = fmt::format("camera {}: cannot {}: {}{}", camera_->id(), attempt,
                                driver_error(-status), hint_at_camera(-status));
  if (status == -ENODEV) throw CameraGone(text);
  throw std::runtime_error(text);
}

void LibcameraStream::start(const SourceSettings& settings) {
  must("acquire it", camera_->acquire());
  is_acquired_ = true;
  setup_ = set_up(*camera_, settings);
  libcamera::ControlList controls(libcamera::controls::controls);
  try {
    controls = control_list(camera_->controls(), settings.controls);
    if (settings.crop) set_crop(controls, camera_->controls(), *settings.crop);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(fmt::format("camera {}: {}", camera_->id(), error.what()));
  }
  setup_.mode.fps = set_rate(controls, camera_->controls(), settings.fps);
  make_requests();
  camera_->requestCompleted.connect(this, &LibcameraStream::completed);
  camera_->disconnected.connect(this, &LibcameraStream::disconnected);
  must("start capturing", camera_->start(&controls));
  // Some pipelines read the controls of start(), some only those of requests.
  requests_.front()->controls().merge(controls);
  for (const auto& request : requests_) {
    must("queue its buffers", camera_->queueRequest(request.get()));
  }
}

void LibcameraStream::make_requests() {
  allocator_ = std::make_unique<libcamera::FrameBufferAllocator>(camera_);
  must("allocate buffers", allocator_->allocate(setup_.stream));
  for (const auto& buffer : allocator_->buffers(setup_.stream)) {
    if (!planes_.emplace_back(*buffer, setup_.mode.color)) must("map its buffers", -errno);
    requests_.push_back(camera_->createRequest(requests_.size()));
    must("create requests", requests_.back() ? 0 : -ENOMEM);
    must("create requests", requests_.back()->addBuffer(setup_.stream, buffer.get()));
  }
  if (requests_.size() < kLeastRequests) must("allocate three buffers", -ENOMEM);
}

std::string LibcameraStream::description() const {
  return fmt::format("{} ({}, libcamera {})", camera_->id(), model_of(*camera_),
                     libcamera::CameraManager::version());
}

/// Called on libcamera's thread. A request that is cancelled is lost; when all are, the source
/// notices that no image comes. It is not given up at once: a camera that is being unplugged
/// cancels them before it is `disconnected`, and libcamera aborts the process if it is stopped in
/// between.
void LibcameraStream::completed(Request* request) {
  if (request->status() == Request::RequestCancelled) return;
  const std::lock_guard lock(mutex_);
  ready_.push_back(request);
  ::eventfd_write(event_.get(), 1);
}

/// Called on libcamera's thread.
void LibcameraStream::disconnected() {
  const std::lock_guard lock(mutex_);
  failure_ = "the camera is unplugged";
  ::eventfd_write(event_.get(), 1);
}

Result<std::optional<CameraBuffer>> LibcameraStream::borrow() {
  const std::lock_guard lock(mutex_);
  if (ready_.empty()) {
    if (!failure_.empty()) return Error{failure_};
    eventfd_t ignored = 0;
    ::eventfd_read(event_.get(), &ignored);
    return std::optional<CameraBuffer>();
  }
  Request* const request = ready_.front();
  ready_.pop_front();
  return std::optional(lend(*request));
}

CameraBuffer LibcameraStream::lend(Request& request) {
  const FrameBuffer& buffer = *request.findBuffer(setup_.stream);
  const libcamera::FrameMetadata& frame = buffer.metadata();
  CameraBuffer lent;
  lent.index = static_cast<std::uint32_t>(request.cookie());
  lent.sequence = frame.sequence;
  lent.stamp_ns = stamp_ns_of(request.metadata(), frame);
  lent.exposure_ns = exposure_ns_of(request.metadata());
  lent.is_corrupt = frame.status == libcamera::FrameMetadata::FrameError;
  const LibcameraPlanes& planes = planes_[lent.index];
  planes.begin_reading();
  lent.data = filled(buffer, planes, 0);
  lent.chroma = {filled(buffer, planes, 1), filled(buffer, planes, 2)};
  return lent;
}

std::optional<Error> LibcameraStream::give_back(const CameraBuffer& buffer) {
  Request& request = *requests_[buffer.index];
  planes_[buffer.index].end_reading();
  request.reuse(Request::ReuseBuffers);
  const int status = camera_->queueRequest(&request);
  if (status == 0) return std::nullopt;
  return system_error("cannot queue a buffer", -status);
}

}  // namespace

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

std::unique_ptr<CameraStream> open_libcamera_stream(const SourceSettings& settings) {
  auto stream = std::make_unique<LibcameraStream>(settings.camera);
  stream->start(settings);
  return stream;
}

}  // namespace orbbuf
