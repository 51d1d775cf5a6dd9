// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <optional>
#include <random>

#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// An inertial sensor on the camera of the generated scene (SceneSource): what it would measure 200
/// times a second, with the noise and the bias of an MPU-6050 (its data sheet, 6.1 and 6.2). The
/// axes are the camera's: x right, y down, z forward, which is down to the floor that it films from
/// 1 m above; a view is 1 m wide. A sample is captured at its time, as the first frame was at its
/// own, or, if frames come faster than that, with the first one that is not older. The first frame
/// is the scene's begin, and the scene must not be looped. Thread-bound to `main`.
class GeneratedSamples final : public SampleSource {
 public:
  static constexpr std::int64_t kStepNs = 5'000'000;

  GeneratedSamples(boost::asio::io_context& main, Take take)
      : take_(std::move(take)), timer_(main) {}

  void on_frame(std::int64_t time_ns) override;

 private:
  void take_until(std::int64_t since_begin_ns);
  void wait_for_next();
  Sample sample_at(std::int64_t since_begin_ns);

  const Take take_;
  std::optional<std::int64_t> begin_ns_;
  std::int64_t next_ns_ = 0;                     // since begin_ns_
  std::mt19937 random_{};                        // the same each time
  std::chrono::steady_clock::time_point begin_;  // set with begin_ns_
  boost::asio::steady_timer timer_;
};

}  // namespace orbbuf
