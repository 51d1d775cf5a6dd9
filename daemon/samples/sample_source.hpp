// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "common/sample.hpp"

namespace orbbuf {

/// A `[stream.NAME]` of orbbufd.toml.
struct SampleStreamSettings {
  std::string name;  ///< of the sensor: wire::is_sample_stream()
  std::string kind;  ///< `euroc`
  std::filesystem::path path;
  std::uint64_t memory_bytes = 40U << 20;  ///< ten minutes at 1 kHz
};

/// Where the samples of one sensor come from. Thread-bound to `main`; never blocks.
class SampleSource {
 public:
  virtual ~SampleSource() = default;
  /// Hands on, in their order, all samples up to `time_ns` that were not handed on before. A frame
  /// of that time was captured.
  virtual void read_until(std::int64_t time_ns, const std::function<void(const Sample&)>& take) = 0;
};

}  // namespace orbbuf
