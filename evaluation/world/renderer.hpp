// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "evaluation/camera.hpp"
#include "evaluation/world/place.hpp"
#include "evaluation/world/route.hpp"
#include "evaluation/world/texture.hpp"

namespace orbbuf::evaluation {

struct Rendered {
  cv::Mat left;   ///< 8 bits
  cv::Mat right;  ///< empty if the camera is mono
  cv::Mat depth;  ///< of the left image, metres along the optical axis, float; empty: not asked for
};

/// What a camera on the route sees. Blurred by its motion while the shutter is open, brighter and
/// darker as its exposure control would have it, with noise; exactly so for the same seed.
class Renderer {
 public:
  Renderer(const Style& style, const Camera& camera, std::uint64_t seed, double duration_s);

  /// The frame whose exposure has its middle at t_s. Thread-safe; 5 to 20 ns a pixel.
  Rendered render(double t_s, bool with_depth) const;

  const Route& route() const { return route_; }

  /// What brightness is multiplied with: 0.65 to 1.4, and in the place of one jump within 0.3 s.
  double gain(double t_s) const;

 private:
  /// What an image column shows of the wall.
  struct Column {
    float depth_m = 0;
    float u = 0;  ///< texels
    float v = 0;  ///< of the floor's height
    float contrast = 0;
    float shade = 0;
    int level = 0;
  };

  cv::Mat view(double t_s, double right_m, cv::Mat* depth) const;
  void add_view(const CameraPose& pose, std::vector<float>& sum, cv::Mat* depth) const;
  Column look(const CameraPose& pose, int x) const;
  float flat(const CameraPose& pose, float depth_m, int x) const;
  double blur_px(double t_s) const;

  Style style_;
  Camera camera_;
  std::uint64_t seed_;
  double duration_s_;
  Route route_;
  Place place_;
  Texture texture_;
  std::vector<float> noise_;
};

}  // namespace orbbuf::evaluation
