// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_formats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <limits>

namespace orbbuf {
namespace {

constexpr std::array<std::string_view, kCameraFormats.size()> kFourccs = {
    "GREY", "NV12", "YU12", "YUYV", "UYVY", "BGR3", "RGB3", "MJPG"};

/// A camera that says 29.97 will do for 30.
constexpr double kRateTolerance = 0.99;

std::string describe(const CameraSize& size) {
  std::string text = fmt::format("{}x{}", size.min_width_px, size.min_height_px);
  if (size.max_width_px > size.min_width_px || size.max_height_px > size.min_height_px) {
    text += fmt::format(" to {}x{}", size.max_width_px, size.max_height_px);
  }
  if (size.rates.empty()) return text;
  const auto count = std::min<std::size_t>(size.rates.size(), 4);
  return fmt::format(
      "{} ({:.4g}{} fps)", text,
      fmt::join(size.rates.begin(), size.rates.begin() + static_cast<int>(count), ", "),
      size.rates.size() > count ? ", ..." : "");
}

/// The best rate at which `offer` has the size; without one it does not have it. Unknown: infinite.
std::optional<double> rate_of(const CameraOffer& offer, const CameraRequest& request) {
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  if (offer.sizes.empty()) return kUnknown;
  std::optional<double> best;
  for (const CameraSize& size : offer.sizes) {
    if (!size.holds(request.width_px, request.height_px)) continue;
    double rate = kUnknown;
    if (!size.rates.empty()) rate = size.rates.front();
    best = best ? std::max(*best, rate) : rate;
  }
  return best;
}

/// Names what is read of `offers`; drivers have dozens of formats.
Error nothing_fits(std::span<const CameraOffer> offers, const CameraRequest& request) {
  std::vector<CameraOffer> read;
  std::ranges::copy_if(offers, std::back_inserter(read), [](const CameraOffer& offer) {
    return format_of(offer.fourcc).has_value();
  });
  return {fmt::format("no {} at {}x{}{}; the camera offers {}",
                      request.format == "auto" ? "supported format" : request.format,
                      request.width_px, request.height_px,
                      request.color ? " in colour (any but GREY)" : "",
                      read.empty() ? describe(offers) : describe(read))};
}

}  // namespace

std::string describe(std::span<const CameraOffer> offers) {
  std::vector<std::string> formats;
  for (const CameraOffer& offer : offers) {
    formats.push_back(fmt::format("{} {}", offer.fourcc, describe_sizes(offer)));
  }
  return formats.empty() ? "nothing" : fmt::format("{}", fmt::join(formats, "; "));
}

std::string describe_sizes(const CameraOffer& offer) {
  std::vector<std::string> sizes;
  for (const CameraSize& size : offer.sizes) sizes.push_back(describe(size));
  return fmt::format("{}", fmt::join(sizes, ", "));
}

std::string list_offers(std::span<const CameraOffer> offers) {
  std::string text;
  std::vector<std::string> others;
  for (const CameraOffer& offer : offers) {
    if (const auto format = format_of(offer.fourcc)) {
      text += fmt::format("  {} {}\n", to_string(*format), describe_sizes(offer));
    } else {
      others.push_back(offer.fourcc);
    }
  }
  if (!others.empty()) text += fmt::format("  unsupported formats: {}\n", fmt::join(others, ", "));
  return text;
}

std::optional<CameraFormat> format_of(std::string_view fourcc) {
  const auto* const found = std::ranges::find(kFourccs, fourcc);
  if (found == kFourccs.end()) return std::nullopt;
  return static_cast<CameraFormat>(found - kFourccs.begin());
}

std::string_view fourcc_of(CameraFormat format) {
  return kFourccs.at(static_cast<std::size_t>(format));
}

bool is_yuv(CameraFormat format) {
  return format == CameraFormat::kNv12 || format == CameraFormat::kYuv420 ||
         format == CameraFormat::kYuyv || format == CameraFormat::kUyvy;
}

Result<CameraFormat> choose_format(std::span<const CameraOffer> offers,
                                   const CameraRequest& request) {
  struct Choice {
    CameraFormat format;
    double rate;
  };
  std::vector<Choice> choices;
  for (std::size_t i = 0; i < kCameraFormats.size(); ++i) {
    const auto format = static_cast<CameraFormat>(i);
    if (request.format != "auto" && request.format != to_string(format)) continue;
    if (request.color && !gives_color(format)) continue;
    const auto offer = std::ranges::find(offers, kFourccs.at(i), &CameraOffer::fourcc);
    const auto rate = offer == offers.end() ? std::nullopt : rate_of(*offer, request);
    if (rate) choices.push_back({format, *rate});
  }
  if (choices.empty()) return nothing_fits(offers, request);
  const double enough = request.fps * kRateTolerance;
  const auto best = std::ranges::max_element(
      choices, {}, [enough](const Choice& choice) { return std::min(choice.rate, enough); });
  return best->format;
}

}  // namespace orbbuf
