// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_probe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/seconds.hpp"
#include "daemon/samples/sample_streams.hpp"

namespace orbbuf {

std::string probe_samples(const SampleStreamSettings& settings, std::chrono::seconds time) {
  boost::asio::io_context io;
  std::vector<std::int64_t> times;
  std::chrono::nanoseconds age{0};  // of the last
  const auto source = make_sample_source(io, settings, [&](const Sample& sample) {
    times.push_back(sample.time_ns);
    age = std::chrono::system_clock::now().time_since_epoch() -
          std::chrono::nanoseconds(sample.time_ns);
  });
  // Those of a file come with the frames, and generated ones from the first frame on without end.
  const bool is_endless = settings.kind == "generated";
  if (is_endless) source->on_frame(0);
  source->on_frame(is_endless ? std::chrono::nanoseconds(time).count()
                              : std::numeric_limits<std::int64_t>::max());
  const bool is_live = times.empty();
  if (is_live) io.run_for(time);
  if (times.size() < 2) {
    return fmt::format("{}: {} samples within {} s\n", settings.name, times.size(), time.count());
  }
  std::vector<double> gaps_ms(times.size() - 1);
  std::transform(times.begin() + 1, times.end(), times.begin(), gaps_ms.begin(),
                 [](auto later, auto sooner) { return static_cast<double>(later - sooner) / 1e6; });
  std::ranges::sort(gaps_ms);
  const auto at = [&](double share) {
    return gaps_ms[static_cast<std::size_t>(share * static_cast<double>(gaps_ms.size() - 1))];
  };
  return fmt::format(
      "{}: {} samples, {:.1f}/s; between two of them {:.2f} ms, in 90 % {:.2f} to {:.2f}, at most "
      "{:.2f}{}\n",
      settings.name, times.size(),
      static_cast<double>(gaps_ms.size()) * 1e9 / static_cast<double>(times.back() - times.front()),
      at(0.5), at(0.05), at(0.95), gaps_ms.back(),
      is_live ? fmt::format("; the last came {:.1f} ms after its time", to_seconds(age) * 1e3)
              : "");
}

}  // namespace orbbuf
