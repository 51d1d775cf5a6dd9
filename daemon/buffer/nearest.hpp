// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// The two candidates nearest to one descriptor. A candidate is one number: the upper bits are its
/// distance (0 .. 256 bits), the lower bits its index. So one comparison orders candidates, and of
/// equal distances the lower index comes first.
struct Nearest {
  static constexpr int kIndexBits = 23;  // 9 are left for the distance
  static constexpr std::uint32_t kNone = ~0U;

  std::uint32_t best = kNone;
  std::uint32_t second = kNone;

  /// Of the best; not an index if there is none.
  std::size_t index() const { return best & ((1U << kIndexBits) - 1); }
  /// In bits; 511, more than any other, if there is none.
  std::uint32_t distance() const { return best >> kIndexBits; }
  std::uint32_t second_distance() const { return second >> kIndexBits; }

  bool operator==(const Nearest&) const = default;
};

/// Eight columns in the layout of the kernels: word w of all eight side by side, and the best and
/// second so far of each column.
struct alignas(64) ColumnBlock {
  static constexpr std::size_t kColumns = 8;
  static constexpr std::size_t kWords = 8;

  std::uint32_t words[kWords][kColumns];
  std::int32_t best[kColumns];  // keys, see nearest_kernel.hpp
  std::int32_t second[kColumns];
};

/// The result of find_nearest() and its working memory. A second use allocates only if the sets are
/// larger than before.
struct Neighbours {
  std::vector<Nearest> of_rows;
  std::vector<Nearest> of_columns;
  std::vector<ColumnBlock> blocks;  // find_nearest's own
};

/// The distance loop for one instruction set. All kernels give the same result.
struct NearestKernel {
  std::string_view name;
  void (*run)(std::span<const Descriptor> rows, std::size_t columns, std::span<ColumnBlock> blocks,
              std::span<Nearest> of_rows);
};

/// The kernels that this machine can run, fastest first; the last is always "portable".
std::span<const NearestKernel* const> nearest_kernels();

/// The two nearest columns of each row and the two nearest rows of each column; fewer than 2^23
/// of either. Reentrant. Cost: one pass over all distances.
void find_nearest(const NearestKernel& kernel, std::span<const Descriptor> rows,
                  std::span<const Descriptor> columns, Neighbours& found);

/// With the fastest kernel of this machine.
void find_nearest(std::span<const Descriptor> rows, std::span<const Descriptor> columns,
                  Neighbours& found);

}  // namespace orbbuf
