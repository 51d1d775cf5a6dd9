// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/euroc_samples.hpp"

#include <fmt/format.h>

#include <fstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace orbbuf {

EurocSamples::EurocSamples(const std::filesystem::path& path, Take take) : take_(std::move(take)) {
  std::ifstream file(path);
  std::string line;
  for (std::size_t number = 1; std::getline(file, line); ++number) {
    if (line.empty() || line.front() == '#' || line == "\r") continue;
    const auto sample = parse_euroc_line(line);
    if (!sample) {
      throw std::runtime_error(fmt::format("{}:{}: {}", path.string(), number, kExpectedEurocLine));
    }
    if (!samples_.empty() && sample->time_ns <= samples_.back().time_ns) {
      throw std::runtime_error(
          fmt::format("{}:{}: the time is not after the one before", path.string(), number));
    }
    samples_.push_back(*sample);
  }
  if (samples_.empty()) {
    throw std::runtime_error("cannot read samples from " + path.string() +
                             ": the file is missing, unreadable or has none");
  }
}

void EurocSamples::on_frame(std::int64_t time_ns) {
  for (; next_ < samples_.size() && samples_[next_].time_ns <= time_ns; ++next_) {
    take_(samples_[next_]);
  }
}

}  // namespace orbbuf
