// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/orb_extractor.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <set>
#include <string>
#include <vector>

#include "common/jpeg.hpp"
#include "common/log.hpp"

namespace orbbuf {
namespace {

constexpr float kScaleFactor = 1.4F;  // between pyramid levels
constexpr int kFastThreshold = 20;    // of FAST: gray levels around a corner; cv::ORB's default
constexpr int kPaleThreshold = 7;     // for images of little contrast; noise is below it
constexpr int kEdgePx = 31;           // cv::ORB's default: it finds nothing this close to an edge
constexpr int kDescriptorBytes = 32;

/// Byte k of the descriptor becomes bits 8k..8k+7, on machines of any byte order.
Descriptor descriptor_of(const std::uint8_t* bytes) {
  Descriptor descriptor{};
  for (std::size_t i = 0; i < kDescriptorBytes; ++i) {
    descriptor[i / 8] |= static_cast<std::uint64_t>(bytes[i]) << (8 * (i % 8));
  }
  return descriptor;
}

/// In an image over 32 times as high as wide, the lowest features get the end of the range.
ImagePoint position_of(const cv::Point2f& point, int width_px) {
  const auto scaled = [width_px](float px) {
    return static_cast<std::int16_t>(
        std::min(std::lround(px * ImagePoint::kWidth / static_cast<float>(width_px)), 32767L));
  };
  return {scaled(point.x), scaled(point.y)};
}

/// The least reduction after which at most `pixels` are left, if one of the decoder's suffices.
int scale_of(const EncodedFrame& frame, int pixels) {
  int scale = 1;
  while (scale < 8 && frame.width_px * frame.height_px / (scale * scale) > pixels) scale *= 2;
  return scale;
}

}  // namespace

struct OrbExtractor::State {
  explicit State(const FeatureSettings& settings)
      : pixels(settings.pixels),
        few(static_cast<std::size_t>(settings.count) / 2),
        orb(cv::ORB::create(settings.count, kScaleFactor, settings.levels)) {}

  /// One line for each kind of trouble, not one for each frame.
  void warn_once(const std::string& kind, Sequence sequence, const std::string& why) {
    if (!warned.insert(kind).second) return;
    log_warn("frame {} has no ORB features: {} (further frames like this are not logged)", sequence,
             why);
  }

  void detect(const cv::Mat& image, std::vector<cv::KeyPoint>& points, cv::Mat& rows) {
    for (const int threshold : {kFastThreshold, kPaleThreshold}) {
      orb->setFastThreshold(threshold);
      orb->detectAndCompute(image, cv::noArray(), points, rows);
      if (points.size() >= few) return;
    }
  }

  const int pixels;
  const std::size_t few;
  cv::Ptr<cv::ORB> orb;
  JpegCodec codec;
  std::set<std::string> warned;
};

OrbExtractor::OrbExtractor(const FeatureSettings& settings)
    : state_(std::make_unique<State>(settings)) {}

OrbExtractor::~OrbExtractor() = default;

bool OrbExtractor::is_built() { return true; }

void OrbExtractor::extract(const EncodedFrame& frame, FeatureSet& features) {
  features.clear();
  auto decoded = state_->codec.decode_gray(frame.left(), scale_of(frame, state_->pixels));
  if (!decoded) {
    state_->warn_once("decode", frame.sequence, decoded.error().text);
    return;
  }
  auto& gray = decoded.value();
  if (std::min(gray.width_px, gray.height_px) <= 2 * kEdgePx) return;
  cv::Mat rows;
  std::vector<cv::KeyPoint> points;
  try {
    const cv::Mat image(gray.height_px, gray.width_px, CV_8UC1, gray.pixels.data());
    state_->detect(image, points, rows);
  } catch (const cv::Exception& error) {
    state_->warn_once(error.func, frame.sequence, error.what());
    return;
  }
  for (int i = 0; i < rows.rows; ++i) {
    features.add(descriptor_of(rows.ptr(i)),
                 position_of(points[static_cast<std::size_t>(i)].pt, gray.width_px));
  }
}

}  // namespace orbbuf
