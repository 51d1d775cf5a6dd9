// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <random>

namespace orbbuf::evaluation {

/// A number from low to high: the same on every platform, which the standard's distributions do not
/// promise.
inline double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

/// SplitMix64's mixing step: a number that looks drawn for each `x`.
inline std::uint64_t hash(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// The same as a number from 0 to 1.
inline double hash_unit(std::uint64_t x) { return static_cast<double>(hash(x) >> 11) * 0x1p-53; }

}  // namespace orbbuf::evaluation
