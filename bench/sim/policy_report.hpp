// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "bench/sim/recorded_sequence.hpp"

namespace orbbuf::sim {

struct PolicyReport {
  std::string text;     ///< tables
  std::string results;  ///< RESULT lines
};

/// Every policy over the sequence through outages (trial.hpp), at the lateness of FIFO buffers of
/// 0.25, 0.5 and 1 s and over links of 1.2 and 3 times the need: `outages` for each pair. Then the
/// curve of each policy, from a third as many: the longest gap and the largest step against the
/// time until the stream is live again, for buffers of 0.25 to 2 s; written to `plots` too, for
/// plots.gp.
PolicyReport report_policies(RecordedSequence& sequence, std::size_t outages, std::uint64_t seed,
                             const std::filesystem::path& plots);

}  // namespace orbbuf::sim
