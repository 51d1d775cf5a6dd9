// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>

#include "daemon/buffer/nearest.hpp"

namespace orbbuf {

/// While they work, kernels keep candidates as signed keys, since SSE2 has no other comparison: the
/// top bit of what Nearest holds is flipped, which keeps the order.
constexpr std::uint32_t kFlip = 1U << 31;
constexpr std::int32_t kNoKey = std::numeric_limits<std::int32_t>::max();
static_assert(static_cast<std::uint32_t>(kNoKey) == (Nearest::kNone ^ kFlip));

constexpr Nearest nearest_of_keys(std::int32_t best, std::int32_t second) {
  return {static_cast<std::uint32_t>(best) ^ kFlip, static_cast<std::uint32_t>(second) ^ kFlip};
}

/// Word w of a descriptor, cut into ColumnBlock::kWords.
constexpr std::uint32_t word_of(const Descriptor& descriptor, std::size_t w) {
  return static_cast<std::uint32_t>(descriptor[w / 2] >> (w % 2 * 32));
}

// One a file nearest_*.cpp. Null where it was not compiled for this architecture, or where this
// processor cannot run it.
const NearestKernel* avx2_kernel();
const NearestKernel* sse_kernel();
const NearestKernel* neon_kernel();
const NearestKernel* portable_kernel();

}  // namespace orbbuf
