// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/libcamera/libcamera_formats.hpp"

#include <libcamera/libcamera.h>

#include <algorithm>
#include <stdexcept>

#include "common/log.hpp"

namespace orbbuf {
namespace {

using libcamera::CameraConfiguration;
using libcamera::StreamRole;

constexpr unsigned kLeastBuffersWanted = 4;  // one lent, two with the camera, one on its way

constexpr std::array<libcamera::PixelFormat, kCameraFormats.size()> kPixelFormats = {
    libcamera::formats::R8,     libcamera::formats::NV12, libcamera::formats::YUV420,
    libcamera::formats::YUYV,   libcamera::formats::UYVY, libcamera::formats::RGB888,
    libcamera::formats::BGR888, libcamera::formats::MJPEG};

/// The configuration that the camera suggests for one stream; null if it has none.
std::unique_ptr<CameraConfiguration> suggestion_of(libcamera::Camera& camera) {
  auto suggested = camera.generateConfiguration({StreamRole::VideoRecording});
  if (!suggested || suggested->empty()) {
    suggested = camera.generateConfiguration({StreamRole::Viewfinder});
  }
  return suggested && !suggested->empty() ? std::move(suggested) : nullptr;
}

std::vector<CameraSize> sizes_of(const libcamera::StreamFormats& formats,
                                 const libcamera::PixelFormat& pixels) {
  const auto size_of = [](const libcamera::Size& min, const libcamera::Size& max) {
    return CameraSize{static_cast<int>(min.width),
                      static_cast<int>(min.height),
                      static_cast<int>(max.width),
                      static_cast<int>(max.height),
                      {}};
  };
  const libcamera::SizeRange range = formats.range(pixels);
  if (range.hStep != 0) return {size_of(range.min, range.max)};
  std::vector<CameraSize> sizes;  // a list, of which the range is only the extremes
  for (const auto& size : formats.sizes(pixels)) sizes.push_back(size_of(size, size));
  return sizes;
}

std::string text_of(std::string_view format, int width_px, int height_px) {
  return fmt::format("{} {}x{} px", format, width_px, height_px);
}

[[noreturn]] void refuse(const libcamera::Camera& camera, std::string_view why) {
  throw std::runtime_error(fmt::format("camera {}: {}", camera.id(), why));
}

/// The one stream of `config`, as the pipeline has adjusted it.
CameraMode validate(libcamera::Camera& camera, CameraConfiguration& config,
                    const std::vector<CameraOffer>& offers, bool color) {
  const libcamera::StreamConfiguration& wanted = config.at(0);
  const auto size_text = [&wanted](std::string_view format) {
    return text_of(format, static_cast<int>(wanted.size.width),
                   static_cast<int>(wanted.size.height));
  };
  const auto asked = size_text(to_string(*format_of(wanted.pixelFormat)));
  if (config.validate() == CameraConfiguration::Invalid) {
    refuse(camera, fmt::format("cannot capture {}; the camera offers {}", asked, describe(offers)));
  }
  const auto format = format_of(wanted.pixelFormat);
  if (!format || (color && !gives_color(*format))) {
    refuse(camera, fmt::format("cannot capture {}: libcamera would use {}{}; the camera offers {}",
                               asked, size_text(wanted.pixelFormat.toString()),
                               format ? ", which has no colour" : ", which orbbufd does not read",
                               describe(offers)));
  }
  const auto given = size_text(to_string(*format));
  if (given != asked) log_info("camera {}: captures {} instead of {}", camera.id(), given, asked);
  return {.format = *format,
          .width_px = static_cast<int>(wanted.size.width),
          .height_px = static_cast<int>(wanted.size.height),
          .color = color};
}

}  // namespace

libcamera::PixelFormat pixel_format_of(CameraFormat format) {
  return kPixelFormats.at(static_cast<std::size_t>(format));
}

std::optional<CameraFormat> format_of(const libcamera::PixelFormat& pixels) {
  const auto* const found = std::ranges::find(kPixelFormats, pixels);
  if (found == kPixelFormats.end()) return std::nullopt;
  return static_cast<CameraFormat>(found - kPixelFormats.begin());
}

std::vector<CameraOffer> offers_of(const libcamera::StreamFormats& formats) {
  std::vector<CameraOffer> offers;
  for (const libcamera::PixelFormat& pixels : formats.pixelformats()) {
    const auto format = format_of(pixels);
    offers.push_back(
        {format ? std::string(fourcc_of(*format)) : pixels.toString(), sizes_of(formats, pixels)});
  }
  return offers;
}

std::vector<CameraOffer> offers_of(libcamera::Camera& camera) {
  const auto suggested = suggestion_of(camera);
  return suggested ? offers_of(suggested->at(0).formats()) : std::vector<CameraOffer>();
}

std::string model_of(const libcamera::Camera& camera) {
  const auto model = camera.properties().get(libcamera::properties::Model);
  return model ? std::string(*model) : "unnamed";
}

Result<CameraFormat> choose_to_ask(const std::vector<CameraOffer>& offers,
                                   const CameraRequest& request) {
  auto fitting = choose_format(offers, request);
  if (fitting) return fitting;
  std::vector<CameraOffer> of_any_size = offers;
  for (CameraOffer& offer : of_any_size) offer.sizes.clear();
  if (auto adjustable = choose_format(of_any_size, request)) return adjustable;
  const auto* const named = std::ranges::find(kCameraFormats, request.format);
  if (named == kCameraFormats.end()) return fitting;
  const auto format = static_cast<CameraFormat>(named - kCameraFormats.begin());
  if (request.color && !gives_color(format)) return fitting;
  return format;
}

LibcameraSetup set_up(libcamera::Camera& camera, const SourceSettings& settings) {
  const auto config = suggestion_of(camera);
  if (!config) refuse(camera, "it has no video stream");
  libcamera::StreamConfiguration& wanted = config->at(0);
  const auto offers = offers_of(wanted.formats());
  const auto format = choose_to_ask(offers, {settings.format, settings.width_px, settings.height_px,
                                             settings.fps, settings.color});
  if (!format) refuse(camera, format.error().text);
  wanted.pixelFormat = pixel_format_of(format.value());
  wanted.size = {static_cast<unsigned>(settings.width_px),
                 static_cast<unsigned>(settings.height_px)};
  wanted.bufferCount = std::max(wanted.bufferCount, kLeastBuffersWanted);
  LibcameraSetup setup;
  setup.mode = validate(camera, *config, offers, settings.color);
  if (const int status = camera.configure(config.get()); status != 0) {
    refuse(camera, system_error("cannot configure it", -status).text);
  }
  setup.stream = wanted.stream();
  setup.mode.stride_bytes = setup.stream->configuration().stride;
  return setup;
}

}  // namespace orbbuf
