// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/nearest.hpp"

#include <algorithm>
#include <array>
#include <cassert>

#include "daemon/buffer/nearest_kernel.hpp"

namespace orbbuf {
namespace {

struct Available {
  std::array<const NearestKernel*, 4> kernels{avx2_kernel(), sse_kernel(), neon_kernel(),
                                              portable_kernel()};
  std::span<const NearestKernel* const> present{
      kernels.begin(), std::remove(kernels.begin(), kernels.end(), nullptr)};
};

void fill_blocks(std::span<const Descriptor> columns, std::vector<ColumnBlock>& blocks) {
  constexpr std::size_t kColumns = ColumnBlock::kColumns;
  blocks.resize((columns.size() + kColumns - 1) / kColumns);
  for (std::size_t j = 0; j < blocks.size() * kColumns; ++j) {
    ColumnBlock& block = blocks[j / kColumns];
    const std::size_t lane = j % kColumns;
    const Descriptor column = j < columns.size() ? columns[j] : Descriptor{};
    for (std::size_t w = 0; w < ColumnBlock::kWords; ++w) {
      block.words[w][lane] = word_of(column, w);
    }
    block.best[lane] = block.second[lane] = kNoKey;
  }
}

}  // namespace

std::span<const NearestKernel* const> nearest_kernels() {
  static const Available available;
  return available.present;
}

void find_nearest(const NearestKernel& kernel, std::span<const Descriptor> rows,
                  std::span<const Descriptor> columns, Neighbours& found) {
  assert(rows.size() >> Nearest::kIndexBits == 0 && columns.size() >> Nearest::kIndexBits == 0);
  found.of_rows.assign(rows.size(), Nearest{});
  found.of_columns.resize(columns.size());
  fill_blocks(columns, found.blocks);
  if (!columns.empty()) kernel.run(rows, columns.size(), found.blocks, found.of_rows);
  for (std::size_t j = 0; j < columns.size(); ++j) {
    const ColumnBlock& block = found.blocks[j / ColumnBlock::kColumns];
    const std::size_t lane = j % ColumnBlock::kColumns;
    found.of_columns[j] = nearest_of_keys(block.best[lane], block.second[lane]);
  }
}

void find_nearest(std::span<const Descriptor> rows, std::span<const Descriptor> columns,
                  Neighbours& found) {
  find_nearest(*nearest_kernels().front(), rows, columns, found);
}

}  // namespace orbbuf
