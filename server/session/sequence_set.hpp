// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <map>

#include "common/frame.hpp"

namespace orbbuf {

/// Numbers of frames: a bit each, and 0.6 KB for each 4096 numbers of which one is in it. All are
/// below the largest Sequence.
class SequenceSet {
 public:
  /// False: it is there already.
  bool insert(Sequence number) {
    std::uint64_t& word = chunks_[number / kChunk][number % kChunk / kBits];
    const std::uint64_t bit = std::uint64_t{1} << number % kBits;
    const bool is_new = (word & bit) == 0;
    word |= bit;
    return is_new;
  }

  bool contains(Sequence number) const {
    const auto chunk = chunks_.find(number / kChunk);
    return chunk != chunks_.end() &&
           (chunk->second[number % kChunk / kBits] >> number % kBits & 1) != 0;
  }

  bool empty() const { return chunks_.empty(); }

  /// The lowest number from `from` on that is in it, at most `limit`.
  Sequence next_in(Sequence from, Sequence limit) const {
    for (auto chunk = chunks_.lower_bound(from / kChunk); chunk != chunks_.end(); ++chunk) {
      const Sequence begin = chunk->first * kChunk;
      if (begin >= limit) break;
      for (Sequence i = from > begin ? (from - begin) / kBits : 0; i < kWords; ++i) {
        std::uint64_t word = chunk->second[static_cast<std::size_t>(i)];
        const Sequence first = begin + i * kBits;
        if (from > first) word &= ~std::uint64_t{0} << (from - first);
        if (word == 0) continue;
        const Sequence found = first + static_cast<Sequence>(std::countr_zero(word));
        return found < limit ? found : limit;
      }
    }
    return limit;
  }

  /// The lowest number from `from` on that is not in it, at most `limit`.
  Sequence next_out(Sequence from, Sequence limit) const {
    while (from < limit) {
      const auto chunk = chunks_.find(from / kChunk);
      if (chunk == chunks_.end()) return from;
      const std::uint64_t word = ~chunk->second[from % kChunk / kBits] >> from % kBits;
      if (word != 0) {
        from += static_cast<Sequence>(std::countr_zero(word));
        return from < limit ? from : limit;
      }
      from += kBits - from % kBits;
    }
    return limit;
  }

 private:
  static constexpr Sequence kBits = 64;
  static constexpr std::size_t kWords = 64;
  static constexpr Sequence kChunk = kBits * kWords;

  std::map<Sequence, std::array<std::uint64_t, kWords>> chunks_;
};

}  // namespace orbbuf
