// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/image_shift.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "common/jpeg.hpp"

namespace orbbuf {

struct ImageShift::State {
  JpegCodec codec;
  cv::Mat last;
  cv::Mat window;
};

ImageShift::ImageShift() : state_(std::make_unique<State>()) {}
ImageShift::~ImageShift() = default;

std::optional<double> ImageShift::add(std::span<const std::uint8_t> jpeg, int width_px) {
  constexpr int kLeastWidth = 160;  // smaller ones tell too little
  int scale = 8;
  while (scale > 1 && width_px < kLeastWidth * scale) scale /= 2;
  auto decoded = state_->codec.decode_gray(jpeg, scale);
  if (!decoded) {
    state_->last.release();
    return std::nullopt;
  }
  GrayImage& gray = decoded.value();
  cv::Mat image;
  cv::Mat(gray.height_px, gray.width_px, CV_8UC1, gray.pixels.data()).convertTo(image, CV_32F);
  const cv::Mat last = std::exchange(state_->last, image);
  if (last.size() != image.size()) return std::nullopt;
  if (state_->window.size() != image.size()) {
    cv::createHanningWindow(state_->window, image.size(), CV_32F);
  }
  const cv::Point2d moved = cv::phaseCorrelate(last, image, state_->window);
  return std::hypot(moved.x, moved.y);
}

}  // namespace orbbuf
