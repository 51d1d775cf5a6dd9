// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "testing/simulation/run.hpp"

namespace orbbuf::simulation {

struct Verdict {
  std::vector<std::string> problems;
  std::uint64_t sessions = 0;
  std::uint64_t captured = 0;
  std::uint64_t delivered = 0;
  std::uint64_t named = 0;
  std::uint64_t too_young = 0;  ///< neither, within the time that docs/promises.md allows
};

/// docs/promises.md, line by line, from what is on the server's disk.
Verdict judge(const Scenario& scenario, const Run& run);

}  // namespace orbbuf::simulation
