// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/euroc_samples.hpp"

#include <fmt/format.h>

#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "common/decimal.hpp"
#include "common/log.hpp"

namespace orbbuf {

EurocSamples::EurocSamples(std::filesystem::path path, Take take)
    : path_(std::move(path)), take_(std::move(take)) {
  std::ifstream file(path_);
  std::string line;
  std::size_t passed_over = 0;
  std::string why;  // of the first of them
  const auto pass_over = [&](std::size_t number, std::string_view reason) {
    if (passed_over++ == 0) why = fmt::format("line {}: {}", number, reason);
  };
  for (std::size_t number = 1; std::getline(file, line); ++number) {
    if (line.empty() || line.front() == '#' || line == "\r") continue;
    const auto sample = parse_euroc_line(line);
    const std::size_t count = samples_.size();
    if (!sample) {
      pass_over(number, kExpectedEurocLine);
    } else if (count == 0 || sample->time_ns > samples_.back().time_ns) {
      samples_.push_back(*sample);
    } else if (sample->time_ns < samples_.back().time_ns &&
               (count == 1 || sample->time_ns > samples_[count - 2].time_ns)) {
      pass_over(number, "the time of the sample before it is later");  // which jumped ahead
      samples_.back() = *sample;
    } else {
      pass_over(number, "the time is not after the one before");
    }
  }
  if (samples_.empty()) {
    throw std::runtime_error(
        fmt::format("cannot read samples from {}: {}", path_.string(),
                    why.empty() ? "the file is missing, unreadable or has none" : why));
  }
  if (passed_over > 0) {
    log_warn("{}: {} of {} lines passed over; the first: {}", path_.string(), passed_over,
             passed_over + samples_.size(), why);
  }
}

EurocSamples::~EurocSamples() {
  if (next_ > 0 || !last_frame_ns_) return;
  log_warn("{}: no sample is as early as any frame: the first is of {} s, the last frame of {} s",
           path_.string(), format_seconds(samples_.front().time_ns),
           format_seconds(*last_frame_ns_));
}

void EurocSamples::on_frame(std::int64_t time_ns) {
  if (!last_frame_ns_ && samples_.back().time_ns < time_ns) {
    log_warn(
        "{}: all samples are older than the first frame: the last is of {} s, the frame of {} s",
        path_.string(), format_seconds(samples_.back().time_ns), format_seconds(time_ns));
  }
  last_frame_ns_ = time_ns;
  for (; next_ < samples_.size() && samples_[next_].time_ns <= time_ns; ++next_) {
    take_(samples_[next_]);
  }
}

}  // namespace orbbuf
