// SPDX-License-Identifier: Apache-2.0
#define ORBBUF_TARGET

#include "daemon/buffer/nearest_kernel.hpp"
#include "daemon/buffer/nearest_loop.hpp"

namespace orbbuf {
namespace {

struct Portable {
  using Words = std::uint32_t __attribute__((vector_size(16)));
  using Keys = std::int32_t __attribute__((vector_size(16)));

  static constexpr std::uint32_t kPairs = 0x55555555;
  static constexpr std::uint32_t kNibbles = 0x33333333;
  static constexpr std::uint32_t kBytes = 0x0f0f0f0f;

  ORBBUF_TARGET static Words nibbles(Words x) {
    x -= (x >> 1) & kPairs;
    return (x & kNibbles) + ((x >> 2) & kNibbles);
  }
  ORBBUF_TARGET static Words bytes(const Words& x) { return (x & kBytes) + ((x >> 4) & kBytes); }

  ORBBUF_TARGET static Words distance(Words (&x)[8]) {
    carry_save(x);
    const Words ones = bytes(nibbles(x[0]) + nibbles(x[7]));
    const Words fours = nibbles(x[3]);
    const Words twos = bytes(nibbles(x[1]) + fours + fours);
    const Words sum = ones + twos + twos;
    // The sum of all bytes may be 256, so the last addition has 16 bits; the upper bits are not
    // used.
    const Words halves = (sum & 0x00ff00ff) + ((sum >> 8) & 0x00ff00ff);
    return halves + (halves >> 16);
  }
};

}  // namespace

const NearestKernel* portable_kernel() {
  static constexpr NearestKernel kKernel{"portable", NearestLoop<Portable>::run};
  return &kKernel;
}

}  // namespace orbbuf
