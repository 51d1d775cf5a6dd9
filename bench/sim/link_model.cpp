// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/link_model.hpp"

#include <cmath>

namespace orbbuf::sim {

std::int64_t LinkModel::finish(std::int64_t start_ns, std::size_t bytes) const {
  const auto needed_ns =
      static_cast<std::int64_t>(std::llround(static_cast<double>(bytes) / bytes_per_s * 1e9));
  if (start_ns >= outage_end_ns || start_ns + needed_ns <= outage_begin_ns) {
    return start_ns + needed_ns;
  }
  const std::int64_t before_ns = outage_begin_ns > start_ns ? outage_begin_ns - start_ns : 0;
  return outage_end_ns + needed_ns - before_ns;
}

}  // namespace orbbuf::sim
