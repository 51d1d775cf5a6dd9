// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <random>

#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// An inertial sensor on the camera of the generated scene (SceneSource): what it would measure 200
/// times a second, with the noise and the bias of an MPU-6050 (its data sheet, 6.1 and 6.2). The
/// axes are the camera's: x right, y down, z forward, which is down to the floor that it films from
/// 1 m above; a view is 1 m wide. A sample counts as captured with the first frame that is not
/// older. The first frame is the scene's begin, and the scene must not be looped.
class GeneratedSamples final : public SampleSource {
 public:
  static constexpr std::int64_t kStepNs = 5'000'000;

  explicit GeneratedSamples(Take take) : take_(std::move(take)) {}

  void on_frame(std::int64_t time_ns) override;

 private:
  Sample sample_at(std::int64_t since_begin_ns);

  const Take take_;
  std::optional<std::int64_t> begin_ns_;
  std::int64_t next_ns_ = 0;  // since begin_ns_
  std::mt19937 random_{};     // the same each time
};

}  // namespace orbbuf
