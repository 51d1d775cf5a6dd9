// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/nearest_kernel.hpp"

#if defined(__aarch64__) || defined(__arm__)
#include <arm_neon.h>
#include <sys/auxv.h>

#ifdef __arm__
#include <asm/hwcap.h>
#define ORBBUF_TARGET __attribute__((target("fpu=neon")))
#else
#define ORBBUF_TARGET
#endif
#include "daemon/buffer/nearest_loop.hpp"

namespace orbbuf {
namespace {

struct Neon {
  using Words = uint32x4_t;
  using Keys = int32x4_t;

  // Here counting is one instruction, so adding bits beforehand would not pay.
  ORBBUF_TARGET static Words distance(Words (&x)[8]) {
    uint8x16_t sum = vcntq_u8(vreinterpretq_u8_u32(x[0]));
#pragma GCC unroll 8
    for (int w = 1; w < 8; ++w) sum = vaddq_u8(sum, vcntq_u8(vreinterpretq_u8_u32(x[w])));
    return vpaddlq_u16(vpaddlq_u8(sum));
  }
};

// 64-bit ARM always has NEON.
bool has_neon() {
#ifdef __arm__
  return (getauxval(AT_HWCAP) & HWCAP_NEON) != 0;
#else
  return true;
#endif
}

}  // namespace

const NearestKernel* neon_kernel() {
  static constexpr NearestKernel kKernel{"neon", NearestLoop<Neon>::run};
  return has_neon() ? &kKernel : nullptr;
}

}  // namespace orbbuf
#else
const orbbuf::NearestKernel* orbbuf::neon_kernel() { return nullptr; }
#endif
