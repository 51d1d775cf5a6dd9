// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// Replays a file in the form of EuRoC's imu0/data.csv at the pace of the frames: a sample counts
/// as captured with the first frame that is not older. Those behind the last frame are not
/// captured.
class EurocSamples final : public SampleSource {
 public:
  /// Reads the whole file: 56 bytes a sample. Throws std::runtime_error if a line is no sample, or
  /// not newer than the one before.
  EurocSamples(const std::filesystem::path& path, Take take);

  void on_frame(std::int64_t time_ns) override;

 private:
  const Take take_;
  std::vector<Sample> samples_;
  std::size_t next_ = 0;
};

}  // namespace orbbuf
