// SPDX-License-Identifier: Apache-2.0
#include "evaluation/world/texture.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <random>

#include "evaluation/random.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kSmallest = 5;  // texels
constexpr double kLargest = 260;
constexpr int kLeaves = 60000;

/// Radii such that leaves of r to 2r cover as much as those of 2r to 4r.
double draw_radius(std::mt19937_64& random) {
  const double low = 1 / (kSmallest * kSmallest);
  const double high = 1 / (kLargest * kLargest);
  return 1 / std::sqrt(uniform(random, high, low));
}

void paint_leaf(cv::Mat& image, std::mt19937_64& random) {
  const double radius = draw_radius(random);
  const cv::Point centre(static_cast<int>(uniform(random, 0, Texture::kTexels)),
                         static_cast<int>(uniform(random, 0, Texture::kTexels)));
  const cv::Scalar gray(uniform(random, 30, 226));
  const auto width = static_cast<int>(radius * uniform(random, 0.5, 1));
  const auto height = static_cast<int>(radius * uniform(random, 0.5, 1));
  if (uniform(random, 0, 1) < 0.6) {
    cv::rectangle(image, centre - cv::Point(width, height), centre + cv::Point(width, height), gray,
                  cv::FILLED);
  } else {
    cv::ellipse(image, centre, {width, height}, uniform(random, 0, 180), 0, 360, gray, cv::FILLED);
  }
}

}  // namespace

Texture::Texture(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  cv::Mat image(kTexels, kTexels, CV_8U, cv::Scalar(128));
  for (int i = 0; i < kLeaves; ++i) paint_leaf(image, random);
  cv::GaussianBlur(image, image, {}, 0.8);
  while (image.cols >= 4) {
    levels_.push_back(image);
    cv::Mat smaller;
    cv::resize(image, smaller, {}, 0.5, 0.5, cv::INTER_AREA);
    image = smaller;
  }
}

}  // namespace orbbuf::evaluation
