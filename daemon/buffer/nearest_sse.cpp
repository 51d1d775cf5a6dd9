// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/nearest_kernel.hpp"

#if defined(__x86_64__) || defined(__i386__)
#include <immintrin.h>

#define ORBBUF_TARGET __attribute__((target("sse4.1")))
#include "daemon/buffer/nearest_loop.hpp"

namespace orbbuf {
namespace {

// SSE 4.1 rather than SSSE3, which has the shuffle but neither min nor max of such keys; only the
// first Core 2 has one without the other.
struct Sse {
  using Words = std::uint32_t __attribute__((vector_size(16)));
  using Keys = std::int32_t __attribute__((vector_size(16)));

  // The bits of each byte: those of its two halves, looked up.
  ORBBUF_TARGET static __m128i bytes(const Words& x) {
    const __m128i bits_of = _mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4);
    const Words low = x & 0x0f0f0f0f;
    const Words high = (x >> 4) & 0x0f0f0f0f;
    return _mm_add_epi8(_mm_shuffle_epi8(bits_of, reinterpret_cast<__m128i>(low)),
                        _mm_shuffle_epi8(bits_of, reinterpret_cast<__m128i>(high)));
  }
  ORBBUF_TARGET static Words distance(Words (&x)[8]) {
    carry_save(x);
    __m128i sum = bytes(x[3]);
    sum = _mm_add_epi8(_mm_add_epi8(sum, sum), bytes(x[1]));
    sum = _mm_add_epi8(_mm_add_epi8(sum, sum), _mm_add_epi8(bytes(x[0]), bytes(x[7])));
    sum = _mm_maddubs_epi16(sum, _mm_set1_epi8(1));
    return reinterpret_cast<Words>(_mm_madd_epi16(sum, _mm_set1_epi16(1)));
  }
};

}  // namespace

const NearestKernel* sse_kernel() {
  static constexpr NearestKernel kKernel{"sse", NearestLoop<Sse>::run};
  return __builtin_cpu_supports("sse4.1") ? &kKernel : nullptr;
}

}  // namespace orbbuf
#else
const orbbuf::NearestKernel* orbbuf::sse_kernel() { return nullptr; }
#endif
