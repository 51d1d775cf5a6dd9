// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/mobile_link.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string_view>

namespace orbbuf::sim {
namespace {

constexpr double kMahimahiStepS = 0.5;
constexpr double kMahimahiBytes = 1500;  // a line is a chance to send so many

void read_ghent(std::ifstream& in, RateTrace& trace) {
  const std::string text(std::istreambuf_iterator<char>(in), {});
  const std::string_view key = R"("duration_ms")";
  for (auto at = text.find(key); at != std::string::npos; at = text.find(key, at + 1)) {
    double duration_ms = 0;
    double kbit_s = 0;
    if (std::sscanf(text.c_str() + at, R"("duration_ms" : %lf , "bandwidth_kbps" : %lf)",
                    &duration_ms, &kbit_s) != 2) {
      throw std::runtime_error(trace.name + ": cannot read \"" +
                               text.substr(at, text.find('}', at) - at) + '"');
    }
    trace.steps.push_back({duration_ms * 1e-3, kbit_s * 1000 / 8});
  }
}

void read_mahimahi(std::ifstream& in, RateTrace& trace) {
  std::vector<double> packets;
  for (double at_ms = 0; in >> at_ms;) {
    const auto step = static_cast<std::size_t>(at_ms * 1e-3 / kMahimahiStepS);
    if (packets.size() <= step) packets.resize(step + 1, 0);
    ++packets[step];
  }
  for (const double count : packets) {
    trace.steps.push_back({kMahimahiStepS, count * kMahimahiBytes / kMahimahiStepS});
  }
}

}  // namespace

double RateTrace::duration_s() const {
  double sum = 0;
  for (const Step& step : steps) sum += step.duration_s;
  return sum;
}

double RateTrace::mean_bytes_per_s() const {
  double sum = 0;
  for (const Step& step : steps) sum += step.duration_s * step.bytes_per_s;
  return sum / duration_s();
}

RateTrace read_trace(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  RateTrace trace{file.stem().string(), {}};
  if (file.extension() == ".up") {
    read_mahimahi(in, trace);
  } else {
    read_ghent(in, trace);
  }
  if (trace.steps.empty() || trace.mean_bytes_per_s() <= 0) {
    throw std::runtime_error(file.string() + ": no link in it");
  }
  return trace;
}

std::int64_t finish(const RateTrace& trace, double scale, double offset_s, std::int64_t start_ns,
                    std::size_t bytes) {
  const double start_s = static_cast<double>(start_ns) * 1e-9;
  double into_s = std::fmod(offset_s + start_s, trace.duration_s());
  std::size_t step = 0;
  while (step + 1 < trace.steps.size() && into_s >= trace.steps[step].duration_s) {
    into_s -= trace.steps[step++].duration_s;
  }
  double now_s = start_s;
  for (auto left = static_cast<double>(bytes);;) {
    const double rate = trace.steps[step].bytes_per_s * scale;
    const double rest_s = std::max(0.0, trace.steps[step].duration_s - into_s);
    if (rate * rest_s >= left) return std::llround((now_s + left / rate) * 1e9);
    left -= rate * rest_s;
    now_s += rest_s;
    into_s = 0;
    step = (step + 1) % trace.steps.size();
  }
}

}  // namespace orbbuf::sim
