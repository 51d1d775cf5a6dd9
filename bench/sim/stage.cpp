// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/stage.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>

#include "daemon/buffer/similarity.hpp"

namespace orbbuf::sim {
namespace {

constexpr double kLostMotion = 1;  // between neighbours that share nothing: all of the width

FramePtr with_time(const EncodedFrame& frame, std::int64_t time_ns, std::size_t number) {
  EncodedFrame copy;
  copy.sequence = number;
  copy.capture_time_ns = time_ns;
  copy.quality = frame.quality;
  copy.jpeg.resize(frame.jpeg.size());
  return std::make_shared<const EncodedFrame>(std::move(copy));
}

}  // namespace

Stage::Stage(RecordedSequence& sequence, double shortest_s) : sequence_(sequence) {
  std::vector<double> steps;  // steps[i]: from frame i of the sequence to the next
  for (std::size_t i = 0; i + 1 < sequence.size(); ++i) {
    const auto motion = image_motion(sequence.features(i), sequence.features(i + 1));
    steps.push_back(motion.value_or(kLostMotion));
  }
  const auto interval_ns = [&](std::size_t i) {
    return sequence.frame(i + 1)->capture_time_ns - sequence.frame(i)->capture_time_ns;
  };
  double sum = 0;
  for (const double step : steps) sum += step;
  const double ns_per_motion =
      static_cast<double>(sequence.frames().back()->capture_time_ns) / std::max(sum, 1e-9);
  std::int64_t time_ns = 0;
  std::int64_t both_ns = 0;
  double motion = 0;
  bool is_forwards = true;
  for (std::size_t at = 0; static_cast<double>(time_ns) * 1e-9 < shortest_s;) {
    const std::size_t number = frames_.size();
    const EncodedFrame& frame = *sequence.frame(at);
    origin_.push_back(at);
    frames_.push_back(with_time(frame, time_ns, number));
    motion_.push_back(motion);
    by_motion_.push_back(with_time(frame, std::llround(motion * ns_per_motion), number));
    by_both_.push_back(with_time(frame, both_ns, number));
    if (is_forwards ? at + 1 == sequence.size() : at == 0) is_forwards = !is_forwards;
    const std::size_t left = is_forwards ? at : at - 1;
    time_ns += interval_ns(left);
    motion += steps[left];
    both_ns += std::max<std::int64_t>(interval_ns(left), std::llround(steps[left] * ns_per_motion));
    at = is_forwards ? at + 1 : at - 1;
  }
}

}  // namespace orbbuf::sim
