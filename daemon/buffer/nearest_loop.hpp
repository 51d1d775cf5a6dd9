// SPDX-License-Identifier: Apache-2.0
#pragma once

// The loop that all kernels share. Each nearest_*.cpp compiles its own copy, for the instruction
// set that the attribute ORBBUF_TARGET, defined before this is included, lets functions use. Every
// function here that touches a vector carries it, and none is a lambda, which could not: GCC cuts
// the vectors of a function without it into pieces, even if that is inlined into one with it. The
// anonymous namespace keeps the linker from taking one copy for another.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "daemon/buffer/nearest_kernel.hpp"

#define ORBBUF_INLINE ORBBUF_TARGET __attribute__((always_inline)) inline

namespace orbbuf {
namespace {

/// Shows each row to all columns, one block of them at a time. An Isa provides
///   Words, Keys  vectors of u32 and i32, a lane for each column; one block or a part of it
///   distance     how many bits are set in eight words, in the low nine bits of each lane; may
///                spoil the words
template <class Isa>
class NearestLoop {
  using Words = typename Isa::Words;
  using Keys = typename Isa::Keys;
  static constexpr std::size_t kLanes = sizeof(Words) / sizeof(std::uint32_t);
  static_assert(ColumnBlock::kColumns % kLanes == 0);

  // What one row has seen is kept lane by lane until the end.
  struct Row {
    Words words[ColumnBlock::kWords];
    Words index;  // its own, flipped, in all lanes
    Keys best;
    Keys second;
  };

  template <class Vector, class Lane>
  ORBBUF_INLINE static Vector load(const Lane* lanes) {
    Vector vector;
    __builtin_memcpy(&vector, lanes, sizeof(vector));
    return vector;
  }

  template <class Vector, class Lane>
  ORBBUF_INLINE static void store(Lane* lanes, const Vector& vector) {
    __builtin_memcpy(lanes, &vector, sizeof(vector));
  }

  ORBBUF_INLINE static void start(Row& row, const Descriptor& descriptor, std::size_t index) {
    for (std::size_t w = 0; w < ColumnBlock::kWords; ++w) {
      row.words[w] = Words{} + word_of(descriptor, w);
    }
    row.index = Words{} + (static_cast<std::uint32_t>(index) ^ kFlip);
    row.best = Keys{} + kNoKey;
    row.second = row.best;
  }

  ORBBUF_INLINE static void offer(Keys& best, Keys& second, const Keys& candidate) {
    const Keys worse = best < candidate ? candidate : best;
    second = second < worse ? second : worse;
    best = best < candidate ? best : candidate;
  }

  // Shows the row and kLanes columns to each other. `index`: of the columns, flipped.
  ORBBUF_INLINE static void meet(Row& row, ColumnBlock& block, std::size_t lane,
                                 const Words& index) {
    Words bits[ColumnBlock::kWords];
#pragma GCC unroll 8
    for (std::size_t w = 0; w < ColumnBlock::kWords; ++w) {
      bits[w] = row.words[w] ^ load<Words>(block.words[w] + lane);
    }
    const Words distance = Isa::distance(bits) << Nearest::kIndexBits;
    offer(row.best, row.second, reinterpret_cast<Keys>(distance + index));
    Keys best = load<Keys>(block.best + lane);
    Keys second = load<Keys>(block.second + lane);
    offer(best, second, reinterpret_cast<Keys>(distance + row.index));
    store(block.best + lane, best);
    store(block.second + lane, second);
  }

  // The same, but what the row sees in the lanes from column `end` on is forgotten.
  ORBBUF_INLINE static void meet_tail(Row& row, ColumnBlock& block, std::size_t lane,
                                      const Words& index, std::size_t end) {
    const Keys best = row.best;
    const Keys second = row.second;
    meet(row, block, lane, index);
    const auto flipped_end = static_cast<std::int32_t>(static_cast<std::uint32_t>(end) ^ kFlip);
    const auto is_column = reinterpret_cast<Keys>(index) < (Keys{} + flipped_end);
    row.best = is_column ? row.best : best;
    row.second = is_column ? row.second : second;
  }

  ORBBUF_INLINE static Nearest reduce(const Row& row) {
    std::int32_t best = kNoKey;
    std::int32_t second = kNoKey;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::int32_t lane_best = row.best[lane];
      const std::int32_t lane_second = row.second[lane];
      second = std::min({second, lane_second, std::max(best, lane_best)});
      best = std::min(best, lane_best);
    }
    return nearest_of_keys(best, second);
  }

 public:
  ORBBUF_TARGET static void run(std::span<const Descriptor> rows, std::size_t columns,
                                std::span<ColumnBlock> blocks, std::span<Nearest> of_rows) {
    constexpr std::size_t kColumns = ColumnBlock::kColumns;
    Words first;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      first[lane] = static_cast<std::uint32_t>(lane) ^ kFlip;
    }
    const std::span<ColumnBlock> full = blocks.first(columns / kColumns);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      Row row;
      start(row, rows[i], i);
      Words index = first;
      for (ColumnBlock& block : full) {
        for (std::size_t lane = 0; lane < kColumns; lane += kLanes) {
          meet(row, block, lane, index);
          index += static_cast<std::uint32_t>(kLanes);
        }
      }
      for (std::size_t j = full.size() * kColumns; j < columns; j += kLanes) {
        meet_tail(row, blocks.back(), j % kColumns, index, columns);
        index += static_cast<std::uint32_t>(kLanes);
      }
      of_rows[i] = reduce(row);
    }
  }
};

// A full adder in every bit: afterwards a holds the sums, b the carries, which count double.
template <class Words>
ORBBUF_INLINE void add_bits(Words& a, Words& b, const Words& c) {
  const Words either = a ^ b;
  const Words carry = (a & b) | (either & c);
  a = either ^ c;
  b = carry;
}

/// Leaves words to count for one bit each in x[0] and x[7], for two in x[1], for four in x[3]:
/// half as many as before (Harley and Seal).
template <class Words>
ORBBUF_INLINE void carry_save(Words (&x)[ColumnBlock::kWords]) {
  add_bits(x[0], x[1], x[2]);
  add_bits(x[3], x[4], x[5]);
  add_bits(x[0], x[3], x[6]);
  add_bits(x[1], x[3], x[4]);
}

}  // namespace
}  // namespace orbbuf
