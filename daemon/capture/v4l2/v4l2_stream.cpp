// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/v4l2/v4l2_stream.hpp"

#include <fmt/core.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "daemon/capture/buffer_mapping.hpp"
#include "daemon/capture/v4l2/v4l2_controls.hpp"
#include "daemon/capture/v4l2/v4l2_device.hpp"

namespace orbbuf {
namespace {

constexpr __u32 kType = V4L2_BUF_TYPE_VIDEO_CAPTURE;
constexpr __u32 kBuffers = 4;       // to ask for: the driver may give more, or fewer
constexpr __u32 kLeastBuffers = 3;  // one lent, two with the driver

v4l2_buffer buffer_of(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = kType;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  return buffer;
}

__u32 fourcc_code(CameraFormat format) {
  const auto text = fourcc_of(format);
  return v4l2_fourcc(static_cast<__u32>(text[0]), static_cast<__u32>(text[1]),
                     static_cast<__u32>(text[2]), static_cast<__u32>(text[3]));
}

std::size_t least_stride(CameraFormat format, int width_px) {
  const auto width = static_cast<std::size_t>(width_px);
  switch (format) {
    case CameraFormat::kYuyv:
    case CameraFormat::kUyvy:
      return 2 * width;
    case CameraFormat::kBgr24:
    case CameraFormat::kRgb24:
      return 3 * width;
    default:
      return width;
  }
}

Crop crop_of(const v4l2_rect& part) {
  return {static_cast<int>(part.width), static_cast<int>(part.height), part.left, part.top};
}

v4l2_selection selection_of(__u32 target) {
  v4l2_selection selection{};
  selection.type = kType;
  selection.target = target;
  return selection;
}

/// By what the driver answers when asked for, or to change, the part of the sensor.
bool has_no_crop(int error) { return error == ENOTTY || error == EINVAL || error == ENODATA; }

/// When, by the monotonic clock, which not every driver uses; 0: it does not say.
std::int64_t stamp_of(const v4l2_buffer& buffer) {
  const auto kind = buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK;
  if (kind != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC) return 0;
  return buffer.timestamp.tv_sec * 1'000'000'000LL + buffer.timestamp.tv_usec * 1'000LL;
}

/// Its buffers are mapped here.
class V4l2Stream final : public CameraStream {
 public:
  explicit V4l2Stream(const SourceSettings& settings);
  ~V4l2Stream() override;

  int fd() const override { return device_.fd(); }
  const CameraMode& mode() const override { return mode_; }
  std::string description() const override;
  std::string reset_command() const override { return usb_reset_command(device_.path()); }
  Result<std::optional<CameraBuffer>> borrow() override;
  std::optional<Error> give_back(const CameraBuffer& lent) override;

 private:
  void set_crop(const Crop& crop);
  void undo_crop();
  void set_format(const SourceSettings& settings);
  void set_rate(double fps);
  void map_buffers();

  V4l2Device device_;
  CameraMode mode_;
  std::vector<BufferMapping> buffers_;
};

V4l2Stream::V4l2Stream(const SourceSettings& settings) : device_(settings.device) {
  if (settings.crop) {
    set_crop(*settings.crop);
  } else {
    undo_crop();
  }
  set_format(settings);
  set_rate(settings.fps);
  set_controls(device_, settings.controls);
  map_buffers();
  int type = kType;
  device_.must("start capturing", VIDIOC_STREAMON, &type);
}

V4l2Stream::~V4l2Stream() {
  int type = kType;
  device_.call(VIDIOC_STREAMOFF, &type);  // fails only where the camera is gone
}

std::string V4l2Stream::description() const {
  return fmt::format("{} ({}, {})", device_.path(), device_.name(), device_.bus());
}

/// Before the format, which says what size the part is brought to.
void V4l2Stream::set_crop(const Crop& crop) {
  const auto attempt = fmt::format("crop its sensor to {}", to_string(crop));
  v4l2_selection bounds = selection_of(V4L2_SEL_TGT_CROP_BOUNDS);
  const int error = device_.call(VIDIOC_G_SELECTION, &bounds);
  if (has_no_crop(error)) {
    throw std::runtime_error(fmt::format(
        "camera {}: cannot {}: its driver does not support cropping", device_.path(), attempt));
  }
  if (error != 0) device_.fail(attempt, error);
  v4l2_selection wanted = bounds;
  wanted.target = V4L2_SEL_TGT_CROP;
  wanted.r = {crop.left_px, crop.top_px, static_cast<__u32>(crop.width_px),
              static_cast<__u32>(crop.height_px)};
  device_.must(attempt, VIDIOC_S_SELECTION, &wanted);
  if (crop_of(wanted.r) == crop) return;
  throw std::runtime_error(fmt::format("camera {}: cannot {}: its driver would use {} of {}",
                                       device_.path(), attempt, to_string(crop_of(wanted.r)),
                                       to_string(crop_of(bounds.r))));
}

/// The driver keeps the crop of the last program that used the camera.
void V4l2Stream::undo_crop() {
  v4l2_selection current = selection_of(V4L2_SEL_TGT_CROP);
  v4l2_selection all = selection_of(V4L2_SEL_TGT_CROP_DEFAULT);
  if (device_.call(VIDIOC_G_SELECTION, &current) != 0) return;
  if (device_.call(VIDIOC_G_SELECTION, &all) != 0) return;
  const Crop wanted = crop_of(all.r);
  if (crop_of(current.r) == wanted) return;
  all.target = V4L2_SEL_TGT_CROP;
  const int error = device_.call(VIDIOC_S_SELECTION, &all);
  if (error != 0 && !has_no_crop(error)) {
    device_.fail(fmt::format("crop its sensor to {}", to_string(wanted)), error);
  }
}

void V4l2Stream::set_format(const SourceSettings& settings) {
  const auto offers = device_.offers();
  const auto format = choose_format(offers, {settings.format, settings.width_px, settings.height_px,
                                             settings.fps, settings.color});
  if (!format) {
    throw std::runtime_error(fmt::format("camera {}: {}", device_.path(), format.error().text));
  }
  v4l2_format wanted{};
  wanted.type = kType;
  wanted.fmt.pix.pixelformat = fourcc_code(format.value());
  wanted.fmt.pix.width = static_cast<__u32>(settings.width_px);
  wanted.fmt.pix.height = static_cast<__u32>(settings.height_px);
  wanted.fmt.pix.field = V4L2_FIELD_NONE;
  const auto attempt = fmt::format("capture {} at {}x{}", to_string(format.value()),
                                   settings.width_px, settings.height_px);
  v4l2_format given = wanted;
  device_.must(attempt, VIDIOC_S_FMT, &given);
  const v4l2_pix_format& pixels = given.fmt.pix;
  if (pixels.pixelformat != wanted.fmt.pix.pixelformat || pixels.width != wanted.fmt.pix.width ||
      pixels.height != wanted.fmt.pix.height) {
    throw std::runtime_error(
        fmt::format("camera {}: cannot {}: its driver would use {}x{}; the camera offers {}",
                    device_.path(), attempt, pixels.width, pixels.height, describe(offers)));
  }
  mode_.format = format.value();
  mode_.width_px = settings.width_px;
  mode_.height_px = settings.height_px;
  mode_.color = settings.color;
  mode_.stride_bytes =
      std::max<std::size_t>(pixels.bytesperline, least_stride(mode_.format, mode_.width_px));
}

/// A driver that takes no frame rate captures at its own.
void V4l2Stream::set_rate(double fps) {
  v4l2_streamparm parameters{};
  parameters.type = kType;
  if (device_.call(VIDIOC_G_PARM, &parameters) != 0) return;
  v4l2_captureparm& capture = parameters.parm.capture;
  if ((capture.capability & V4L2_CAP_TIMEPERFRAME) != 0) {
    capture.timeperframe = {1000, static_cast<__u32>(std::lround(fps * 1000))};
    device_.must(fmt::format("set its frame rate to {:.4g} fps", fps), VIDIOC_S_PARM, &parameters);
  }
  if (capture.timeperframe.numerator == 0) return;
  mode_.fps =
      static_cast<double>(capture.timeperframe.denominator) / capture.timeperframe.numerator;
}

void V4l2Stream::map_buffers() {
  v4l2_requestbuffers request{};
  request.count = kBuffers;
  request.type = kType;
  request.memory = V4L2_MEMORY_MMAP;
  device_.must("allocate buffers", VIDIOC_REQBUFS, &request);
  if (request.count < kLeastBuffers) device_.fail("allocate three buffers", ENOMEM);
  for (__u32 i = 0; i < request.count; ++i) {
    v4l2_buffer buffer = buffer_of(i);
    device_.must("query its buffers", VIDIOC_QUERYBUF, &buffer);
    if (!buffers_.emplace_back(device_.fd(), buffer.m.offset, buffer.length)) {
      device_.fail("map its buffers", errno);
    }
    device_.must("queue its buffers", VIDIOC_QBUF, &buffer);
  }
}

Result<std::optional<CameraBuffer>> V4l2Stream::borrow() {
  v4l2_buffer buffer = buffer_of(0);
  const int error = device_.call(VIDIOC_DQBUF, &buffer);
  if (error == EAGAIN) return std::optional<CameraBuffer>();
  if (error != 0) return system_error("cannot dequeue a buffer", error);
  if (buffer.index >= buffers_.size()) return Error{"the driver returned an unknown buffer"};
  const auto memory = buffers_[buffer.index].bytes();
  CameraBuffer borrowed;
  borrowed.index = buffer.index;
  borrowed.sequence = buffer.sequence;
  borrowed.stamp_ns = stamp_of(buffer);
  borrowed.is_corrupt = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0;
  borrowed.data = memory.first(std::min<std::size_t>(buffer.bytesused, memory.size()));
  return std::optional(borrowed);
}

std::optional<Error> V4l2Stream::give_back(const CameraBuffer& lent) {
  v4l2_buffer buffer = buffer_of(lent.index);
  const int error = device_.call(VIDIOC_QBUF, &buffer);
  if (error == 0) return std::nullopt;
  return system_error("cannot queue a buffer", error);
}

}  // namespace

std::unique_ptr<CameraStream> open_v4l2_stream(const SourceSettings& settings) {
  return std::make_unique<V4l2Stream>(settings);
}

}  // namespace orbbuf
