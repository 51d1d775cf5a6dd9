// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_probe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/executor_work_guard.hpp>
#include <limits>
#include <utility>

#include "common/seconds.hpp"
#include "daemon/samples/sample_streams.hpp"

namespace orbbuf {

SampleProbe::SampleProbe(SampleStreamSettings settings)
    : settings_(std::move(settings)),
      source_(make_sample_source(io_, settings_,
                                 [this](const Sample& sample) {
                                   samples_.push_back(sample);
                                   age_ = std::chrono::system_clock::now().time_since_epoch() -
                                          std::chrono::nanoseconds(sample.time_ns);
                                 })),
      thread_([this] {
        const auto until_end = boost::asio::make_work_guard(io_);
        io_.run();
      }) {}

void SampleProbe::end(std::int64_t first_ns, std::int64_t last_ns) {
  io_.stop();
  thread_.join();
  time_ = std::chrono::steady_clock::now() - begin_;
  is_live_ = !samples_.empty();
  constexpr std::int64_t kBeyondNs = 300'000'000;
  source_->on_frame(first_ns);
  source_->on_frame(settings_.kind == "generated" ? last_ns + kBeyondNs
                                                  : std::numeric_limits<std::int64_t>::max());
}

std::string SampleProbe::report() const {
  if (samples_.size() < 2) {
    return fmt::format("{}: {} samples within {:.0f} s\n", settings_.name, samples_.size(),
                       time_.count());
  }
  std::vector<double> gaps_ms(samples_.size() - 1);
  std::transform(samples_.begin() + 1, samples_.end(), samples_.begin(), gaps_ms.begin(),
                 [](const Sample& later, const Sample& sooner) {
                   return static_cast<double>(later.time_ns - sooner.time_ns) / 1e6;
                 });
  std::ranges::sort(gaps_ms);
  const auto at = [&](double share) {
    return gaps_ms[static_cast<std::size_t>(share * static_cast<double>(gaps_ms.size() - 1))];
  };
  const auto time_ns = static_cast<double>(samples_.back().time_ns - samples_.front().time_ns);
  return fmt::format(
      "{}: {} samples, {:.1f}/s; between two of them {:.2f} ms, in 90 % {:.2f} to {:.2f}, at most "
      "{:.2f}{}\n",
      settings_.name, samples_.size(), static_cast<double>(gaps_ms.size()) * 1e9 / time_ns, at(0.5),
      at(0.05), at(0.95), gaps_ms.back(),
      is_live_ ? fmt::format("; the last came {:.1f} ms after its time", to_seconds(age_) * 1e3)
               : "");
}

}  // namespace orbbuf
