// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

namespace orbbuf {

/// How far each image is shifted against the one before it, by the phases of both (Kuglin and Hines
/// 1975): the way of a camera that is turned. Thread-bound. Cost: 1 to 2 ms for 640x480.
class ImageShift {
 public:
  ImageShift();
  ~ImageShift();

  /// In pixels of an image that is reduced by 2, 4 or 8 each way to a width of at least 160.
  /// Nothing for one that cannot be decoded, and for one without one of its size just before it.
  std::optional<double> add(std::span<const std::uint8_t> jpeg, int width_px);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace orbbuf
