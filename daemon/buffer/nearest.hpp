// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// The two candidates nearest to one descriptor. A candidate is its distance (0 .. 256 bits) above
/// its index, so that one comparison orders both and equal distances always have the same winner:
/// the lower index.
struct Nearest {
  static constexpr int kIndexBits = 23;  // 9 are left for the distance
  static constexpr std::uint32_t kNone = ~0U;

  std::uint32_t best = kNone;
  std::uint32_t second = kNone;

  /// Of the best; where there is none, this is no index.
  std::size_t index() const { return best & ((1U << kIndexBits) - 1); }
  /// In bits; 511, thus beyond every other, where there is none.
  std::uint32_t distance() const { return best >> kIndexBits; }
  std::uint32_t second_distance() const { return second >> kIndexBits; }

  bool operator==(const Nearest&) const = default;
};

/// Eight columns as the kernels want them: word w of all eight side by side, and what each column
/// has seen so far.
struct alignas(64) ColumnBlock {
  static constexpr std::size_t kColumns = 8;
  static constexpr std::size_t kWords = 8;

  std::uint32_t words[kWords][kColumns];
  std::int32_t best[kColumns];  // keys, see nearest_kernel.hpp
  std::int32_t second[kColumns];
};

/// The result of find_nearest() and the memory it works in. Used again, it allocates nothing as
/// long as the sets are no larger than before.
struct Neighbours {
  std::vector<Nearest> of_rows;
  std::vector<Nearest> of_columns;
  std::vector<ColumnBlock> blocks;  // find_nearest's own
};

/// The distance loop for one instruction set. All of them give the same bits.
struct NearestKernel {
  std::string_view name;
  void (*run)(std::span<const Descriptor> rows, std::size_t columns, std::span<ColumnBlock> blocks,
              std::span<Nearest> of_rows);
};

/// Those that this machine can run, fastest first; the last is "portable" and always there.
std::span<const NearestKernel* const> nearest_kernels();

/// The two nearest columns of each row and the two nearest rows of each column; fewer than 2^23
/// of either. Reentrant. Cost: one pass over all distances.
void find_nearest(const NearestKernel& kernel, std::span<const Descriptor> rows,
                  std::span<const Descriptor> columns, Neighbours& found);

/// With the fastest kernel of this machine.
void find_nearest(std::span<const Descriptor> rows, std::span<const Descriptor> columns,
                  Neighbours& found);

}  // namespace orbbuf
