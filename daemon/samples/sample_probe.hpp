// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// Takes the samples of a stream, for `orbbufd --probe`, while its user captures frames. Owns a
/// thread until end().
class SampleProbe {
 public:
  /// Throws std::runtime_error if the source cannot be opened.
  explicit SampleProbe(SampleStreamSettings settings);
  SampleProbe(const SampleProbe&) = delete;
  SampleProbe& operator=(const SampleProbe&) = delete;
  ~SampleProbe() { io_.stop(); }

  /// The times of the first and the last frame. No more samples are taken; those of a file come
  /// now, all of them, and of a generated sensor those of that time and 0.3 s more.
  void end(std::int64_t first_ns, std::int64_t last_ns);

  // After end().
  const std::vector<Sample>& samples() const { return samples_; }
  /// A line: how many samples, at what rate, and how long from one to the next.
  std::string report() const;

 private:
  const SampleStreamSettings settings_;
  boost::asio::io_context io_;
  std::vector<Sample> samples_;
  std::chrono::nanoseconds age_{0};  // of the last, when it came
  bool is_live_ = false;
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  std::chrono::duration<double> time_{0};
  std::unique_ptr<SampleSource> source_;
  std::jthread thread_;  // until end() the samples are its
};

}  // namespace orbbuf
