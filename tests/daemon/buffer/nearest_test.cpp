// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/nearest.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <random>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace orbbuf {
namespace {

using Descriptors = std::vector<Descriptor>;

constexpr Descriptor kZeros{};
constexpr Descriptor kOnes{~0ULL, ~0ULL, ~0ULL, ~0ULL};

/// By the definition, without a trick.
Nearest naive_nearest(const Descriptor& from, const Descriptors& to) {
  std::vector<std::pair<int, std::size_t>> order{{511, 0x7fffff}, {511, 0x7fffff}};
  for (std::size_t j = 0; j < to.size(); ++j) {
    int bits = 0;
    for (std::size_t i = 0; i < from.size(); ++i) bits += std::popcount(from[i] ^ to[j][i]);
    order.emplace_back(bits, j);
  }
  std::ranges::partial_sort(order, order.begin() + 2);
  const auto pack = [](std::pair<int, std::size_t> candidate) {
    return static_cast<std::uint32_t>(static_cast<std::size_t>(candidate.first) << 23 |
                                      candidate.second);
  };
  return {pack(order[0]), pack(order[1])};
}

std::vector<Nearest> naive_nearest(const Descriptors& from, const Descriptors& to) {
  std::vector<Nearest> all;
  all.reserve(from.size());
  for (const Descriptor& descriptor : from) all.push_back(naive_nearest(descriptor, to));
  return all;
}

void add_to_digest(std::uint64_t& digest, const std::vector<Nearest>& all) {
  for (const Nearest& nearest : all) {
    for (const std::uint32_t word : {nearest.best, nearest.second}) {
      for (int shift = 0; shift < 32; shift += 8) {
        digest = (digest ^ (word >> shift & 0xff)) * 0x100000001b3;  // FNV-1a
      }
    }
  }
}

/// A machine-independent choice of sets. Each kind is a way to draw one descriptor.
class NearestTest : public testing::Test {
 protected:
  Descriptor any() { return {random_(), random_(), random_(), random_()}; }
  /// Ties and equal descriptors without end.
  Descriptor one_of_five() { return five_[static_cast<std::size_t>(random_() % 5)]; }
  /// Distances of 0 and 256 only.
  Descriptor zeros_or_ones() { return random_() % 2 ? kOnes : kZeros; }
  /// Distances of all sizes, with many ties.
  Descriptor near_zeros() {
    Descriptor descriptor = kZeros;
    for (std::uint64_t bits = random_() % 256; bits > 0; --bits) {
      descriptor[random_() % 4] |= std::uint64_t{1} << (random_() % 64);
    }
    return descriptor;
  }
  Descriptors set_of(std::size_t count, const std::function<Descriptor()>& draw) {
    Descriptors set;
    while (set.size() < count) set.push_back(draw());
    return set;
  }
  /// Every size beside every other, in every kind.
  template <class Check>
  void for_all_sets(Check check) {
    const std::function<Descriptor()> kinds[] = {
        [this] { return any(); }, [this] { return one_of_five(); },
        [this] { return zeros_or_ones(); }, [this] { return near_zeros(); }};
    for (const auto& draw : kinds) {
      for (const std::size_t rows : kSizes) {
        for (const std::size_t columns : kSizes) {
          const Descriptors drawn_first = set_of(rows, draw);
          check(drawn_first, set_of(columns, draw));
        }
      }
    }
  }

 private:
  static constexpr std::size_t kSizes[] = {0, 1, 2, 7, 8, 9, 15, 16, 17, 63, 64, 65, 500};
  std::mt19937_64 random_{1};
  Descriptors five_ = set_of(5, [this] { return any(); });
};

TEST_F(NearestTest, EveryKernelFindsWhatTheDefinitionSays) {
  Neighbours found;  // one for all, so that what is left from before is seen to do no harm
  for_all_sets([&found](const Descriptors& rows, const Descriptors& columns) {
    const std::vector<Nearest> of_rows = naive_nearest(rows, columns);
    const std::vector<Nearest> of_columns = naive_nearest(columns, rows);
    for (const NearestKernel* kernel : nearest_kernels()) {
      find_nearest(*kernel, rows, columns, found);
      // Not EXPECT_EQ, which would print a thousand of them.
      EXPECT_TRUE(found.of_rows == of_rows && found.of_columns == of_columns)
          << kernel->name << " errs on " << rows.size() << " x " << columns.size();
    }
  });
}

TEST_F(NearestTest, TheSameBitsOnEveryArchitecture) {
  std::uint64_t digest = 0xcbf29ce484222325;
  Neighbours found;
  for_all_sets([&](const Descriptors& rows, const Descriptors& columns) {
    find_nearest(rows, columns, found);
    add_to_digest(digest, found.of_rows);
    add_to_digest(digest, found.of_columns);
  });
  EXPECT_EQ(digest, 6425341468812880070U);
}

TEST_F(NearestTest, WhatFillsUpTheLastBlockIsNobodysNeighbour) {
  for (const Descriptor& column : {kZeros, kOnes}) {
    for (const Descriptor& row : {kZeros, kOnes}) {
      const std::uint32_t distance = row == column ? 0 : 256;
      for (const NearestKernel* kernel : nearest_kernels()) {
        Neighbours found;
        find_nearest(*kernel, std::span(&row, 1), std::span(&column, 1), found);
        EXPECT_EQ(found.of_rows[0], (Nearest{distance << 23, Nearest::kNone})) << kernel->name;
        EXPECT_EQ(found.of_columns[0], found.of_rows[0]) << kernel->name;
      }
    }
  }
}

TEST_F(NearestTest, AmongEqualsTheFirstTwoWin) {
  const Descriptors equal(20, any());
  Neighbours found;
  find_nearest(equal, equal, found);
  for (const Nearest& nearest : found.of_rows) EXPECT_EQ(nearest, (Nearest{0, 1}));
  for (const Nearest& nearest : found.of_columns) EXPECT_EQ(nearest, (Nearest{0, 1}));
}

TEST_F(NearestTest, WithNobodyThereIsNoNeighbour) {
  const Descriptor descriptor = any();
  Neighbours found;
  find_nearest(std::span(&descriptor, 1), {}, found);
  EXPECT_EQ(found.of_rows, (std::vector{Nearest{}}));
  EXPECT_TRUE(found.of_columns.empty());
  EXPECT_GT(found.of_rows[0].distance(), 256U);
}

TEST_F(NearestTest, MemoryIsTakenOnceOnly) {
  const Descriptors large = set_of(100, [this] { return any(); });
  const Descriptors small = set_of(9, [this] { return any(); });
  Neighbours found;
  const auto memory = [&found] {
    return std::tuple(found.of_rows.data(), found.of_rows.capacity(), found.of_columns.data(),
                      found.of_columns.capacity(), found.blocks.data(), found.blocks.capacity());
  };
  find_nearest(large, large, found);
  const auto before = memory();
  for (const Descriptors& rows : {small, large}) {
    for (const Descriptors& columns : {small, large}) {
      find_nearest(rows, columns, found);
      EXPECT_EQ(memory(), before);
    }
  }
}

// tests/arm.sh says which kernel a processor must be given, lest the portable one pass for it.
TEST_F(NearestTest, TheFastestKernelIsTheExpectedOne) {
  std::vector<std::string> names;
  for (const NearestKernel* kernel : nearest_kernels()) names.emplace_back(kernel->name);
  for (const std::string& name : names) std::cout << "kernel: " << name << '\n';
  EXPECT_EQ(names.back(), "portable");
  if (const char* expected = std::getenv("ORBBUF_EXPECT_KERNEL")) {
    EXPECT_EQ(names.front(), expected);
  }
}

}  // namespace
}  // namespace orbbuf
