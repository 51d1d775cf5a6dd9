// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace orbbuf::sim {

/// A link of constant rate with one outage, during which nothing moves and nothing is lost.
struct LinkModel {
  double bytes_per_s = 0;
  std::int64_t outage_begin_ns = 0;
  std::int64_t outage_end_ns = 0;

  /// When the last of `bytes` has passed, if the first may set out at `start_ns`.
  std::int64_t finish(std::int64_t start_ns, std::size_t bytes) const;
};

}  // namespace orbbuf::sim
