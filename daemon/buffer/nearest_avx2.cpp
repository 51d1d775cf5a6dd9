// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/nearest_kernel.hpp"

#if defined(__x86_64__) || defined(__i386__)
#include <immintrin.h>

#define ORBBUF_TARGET __attribute__((target("avx2")))
#include "daemon/buffer/nearest_loop.hpp"

namespace orbbuf {
namespace {

struct Avx2 {
  using Words = std::uint32_t __attribute__((vector_size(32)));
  using Keys = std::int32_t __attribute__((vector_size(32)));

  // The bits of each byte: those of its two halves, looked up.
  ORBBUF_TARGET static __m256i bytes(const Words& x) {
    const __m256i bits_of =
        _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
    const Words low = x & 0x0f0f0f0f;
    const Words high = (x >> 4) & 0x0f0f0f0f;
    return _mm256_add_epi8(_mm256_shuffle_epi8(bits_of, reinterpret_cast<__m256i>(low)),
                           _mm256_shuffle_epi8(bits_of, reinterpret_cast<__m256i>(high)));
  }
  ORBBUF_TARGET static Words distance(Words (&x)[8]) {
    carry_save(x);
    __m256i sum = bytes(x[3]);
    sum = _mm256_add_epi8(_mm256_add_epi8(sum, sum), bytes(x[1]));
    sum = _mm256_add_epi8(_mm256_add_epi8(sum, sum), _mm256_add_epi8(bytes(x[0]), bytes(x[7])));
    sum = _mm256_maddubs_epi16(sum, _mm256_set1_epi8(1));
    return reinterpret_cast<Words>(_mm256_madd_epi16(sum, _mm256_set1_epi16(1)));
  }
};

}  // namespace

const NearestKernel* avx2_kernel() {
  static constexpr NearestKernel kKernel{"avx2", NearestLoop<Avx2>::run};
  return __builtin_cpu_supports("avx2") ? &kKernel : nullptr;
}

}  // namespace orbbuf
#else
const orbbuf::NearestKernel* orbbuf::avx2_kernel() { return nullptr; }
#endif
