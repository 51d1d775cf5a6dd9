// SPDX-License-Identifier: Apache-2.0
#include "common/sample.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <charconv>
#include <cmath>

#include "common/byte_order.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kSampleBytes = 56;

template <class Archive>
void fields(Archive& archive, wire::FieldsOf<Archive, Sample>& sample) {
  auto& [x, y, z] = sample.angular_velocity;
  auto& [ax, ay, az] = sample.linear_acceleration;
  archive.fields(sample.time_ns, x, y, z, ax, ay, az);
}

template <class Number>
bool take_field(std::string_view& line, Number& number, bool is_last) {
  const auto skip = std::min(line.find_first_not_of(' '), line.size());
  line.remove_prefix(skip);
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), number);
  if (error != std::errc()) return false;
  line.remove_prefix(static_cast<std::size_t>(end - line.data()));
  const auto rest = std::min(line.find_first_not_of(" \r"), line.size());
  line.remove_prefix(rest);
  if (is_last) return line.empty();
  if (!line.starts_with(',')) return false;
  line.remove_prefix(1);
  return true;
}

bool is_finite(const Sample& sample) {
  const auto finite = [](double value) { return std::isfinite(value); };
  return std::ranges::all_of(sample.angular_velocity, finite) &&
         std::ranges::all_of(sample.linear_acceleration, finite);
}

}  // namespace

std::string to_euroc_line(const Sample& sample) {
  const auto& [x, y, z] = sample.angular_velocity;
  const auto& [ax, ay, az] = sample.linear_acceleration;
  return fmt::format("{},{},{},{},{},{},{}\n", sample.time_ns, x, y, z, ax, ay, az);
}

std::optional<Sample> parse_euroc_line(std::string_view line) {
  Sample sample;
  bool is_sound = take_field(line, sample.time_ns, false);
  for (double& value : sample.angular_velocity) {
    is_sound = is_sound && take_field(line, value, false);
  }
  for (std::size_t i = 0; i < 3; ++i) {
    is_sound = is_sound && take_field(line, sample.linear_acceleration.at(i), i == 2);
  }
  return is_sound && is_finite(sample) ? std::optional(sample) : std::nullopt;
}

namespace wire {

bool is_sample_stream(const StreamDeclaration& stream) {
  return stream.codec == kSampleCodec && is_valid_id(stream.name) && stream.name.starts_with("imu");
}

std::vector<std::uint8_t> encode_samples(std::span<const Sample> samples) {
  assert(!samples.empty() && samples.size() <= kMaxSamplesPerMessage);
  Writer out(0);
  out.put(static_cast<std::uint16_t>(samples.size()));
  for (const Sample& sample : samples) fields(out, sample);
  return std::move(out.bytes());
}

Parsed<std::vector<Sample>> parse_samples(std::span<const std::uint8_t> payload) {
  Reader in(payload);
  const auto count = in.take<std::uint16_t>();
  if (count == 0 || count > kMaxSamplesPerMessage || in.left() != count * kSampleBytes) {
    return Fault{ErrorCode::kMalformed,
                 fmt::format("samples: {} of them in {} bytes", count, payload.size())};
  }
  std::vector<Sample> samples(count);
  for (Sample& sample : samples) {
    fields(in, sample);
    if (!is_finite(sample)) return Fault{ErrorCode::kMalformed, "samples: a number is not finite"};
  }
  return samples;
}

}  // namespace wire
}  // namespace orbbuf
