// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stereo/stereo_pairer.hpp"

#include <memory>
#include <utility>

namespace orbbuf {
namespace {

std::chrono::nanoseconds from_to(const RawFrame& a, const RawFrame& b) {
  return std::chrono::nanoseconds(b.monotonic_ns - a.monotonic_ns);
}

RawFrame pair_of(RawFrame left, RawFrame right) {
  left.right = std::make_shared<const RawFrame>(std::move(right));
  return left;
}

}  // namespace

std::optional<RawFrame> StereoPairer::add(Side side, RawFrame frame) {
  Waiting& own = sides_.at(index(side));
  Waiting& other = sides_.at(1 - index(side));
  while (!other.frames.empty()) {
    const auto apart = from_to(frame, other.frames.front());
    if (apart > tolerance_) {  // and all to come are later still
      ++own.unpaired;
      return std::nullopt;
    }
    const bool has_nearer =
        other.frames.size() > 1 && std::chrono::abs(from_to(frame, other.frames[1])) < abs(apart);
    if (apart < -tolerance_ || has_nearer) {
      other.give_up_first();
      continue;
    }
    RawFrame partner = std::move(other.frames.front());
    other.frames.pop_front();
    ++pairs_;
    return side == Side::kLeft ? pair_of(std::move(frame), std::move(partner))
                               : pair_of(std::move(partner), std::move(frame));
  }
  own.frames.push_back(std::move(frame));
  if (own.frames.size() > kMostWaiting) own.give_up_first();
  return std::nullopt;
}

void StereoPairer::Waiting::give_up_first() {
  frames.pop_front();
  ++unpaired;
}

}  // namespace orbbuf
