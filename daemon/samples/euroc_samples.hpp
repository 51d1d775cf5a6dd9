// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// Replays a file in the form of EuRoC's imu0/data.csv at the pace of the frames: a sample counts
/// as captured with the first frame that is not older. Those behind the last frame are not
/// captured. A line that is no sample, or not newer than the one before, is passed over, and a
/// warning says how many are. So does one that file and frames have no time in common.
class EurocSamples final : public SampleSource {
 public:
  /// Reads the whole file: 56 bytes a sample. Throws std::runtime_error if there is none.
  EurocSamples(std::filesystem::path path, Take take);
  ~EurocSamples() override;
  EurocSamples(const EurocSamples&) = delete;
  EurocSamples& operator=(const EurocSamples&) = delete;

  void on_frame(std::int64_t time_ns) override;

 private:
  const std::filesystem::path path_;
  const Take take_;
  std::vector<Sample> samples_;
  std::size_t next_ = 0;
  std::optional<std::int64_t> last_frame_ns_;
};

}  // namespace orbbuf
