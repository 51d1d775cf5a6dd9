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

template <class Archive>
void fields(Archive& archive, wire::FieldsOf<Archive, TopicPublisher>& writer) {
  archive.fields(writer.key, writer.topic, writer.type, writer.user_data, writer.depth);
  archive.flags(writer.is_reliable, writer.is_latched, writer.is_xcdr2);
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

bool is_name(std::string_view text, std::string_view others) {
  const auto is_part = [others](char c) {
    const bool is_letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
    return is_letter || (c >= '0' && c <= '9') || others.find(c) != std::string_view::npos;
  };
  return !text.empty() && text.size() <= wire::kMaxTopicTextBytes &&
         std::ranges::all_of(text, is_part);
}

wire::Fault malformed(std::string_view what) {
  return {wire::ErrorCode::kMalformed, fmt::format("messages of a topic: {}", what)};
}

std::vector<std::uint8_t> encode_messages(std::span<const Sample> samples) {
  std::vector<const TopicPublisher*> writers;
  std::vector<std::uint16_t> writer_of;
  writer_of.reserve(samples.size());
  for (const Sample& sample : samples) {
    const auto same = std::ranges::find_if(
        writers, [&sample](const auto* writer) { return *writer == *sample.message->publisher; });
    writer_of.push_back(static_cast<std::uint16_t>(same - writers.begin()));
    if (same == writers.end()) writers.push_back(sample.message->publisher.get());
  }
  wire::Writer out(0);
  out.fields(static_cast<std::uint16_t>(samples.size()),
             static_cast<std::uint16_t>(writers.size()));
  for (const TopicPublisher* writer : writers) fields(out, *writer);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const TopicMessage& message = *samples[i].message;
    out.fields(writer_of[i], message.time_ns, static_cast<std::uint32_t>(message.cdr.size()));
    out.put_bytes(message.cdr);
  }
  return std::move(out.bytes());
}

wire::Parsed<std::vector<Sample>> parse_messages(wire::Reader& in, std::size_t count) {
  std::vector<std::shared_ptr<const TopicPublisher>> writers;
  auto left = in.take<std::uint16_t>();
  in.require(left <= count);
  for (; left > 0 && !in.is_short(); --left) {
    TopicPublisher writer;
    fields(in, writer);
    if (!in.is_short() && !wire::is_valid(writer)) return malformed("a publisher is not valid");
    writers.push_back(std::make_shared<const TopicPublisher>(std::move(writer)));
  }
  std::vector<Sample> samples;
  for (; count > 0 && !in.is_short(); --count) {
    TopicMessage message;
    const auto writer = in.take<std::uint16_t>();
    message.time_ns = in.take<std::int64_t>();
    in.require(writer < writers.size());
    const auto cdr = in.take_bytes(in.take<std::uint32_t>());
    in.require(cdr.size() >= wire::kMinTopicMessageBytes);
    if (in.is_short()) break;
    message.publisher = writers[writer];
    message.cdr.assign(cdr.begin(), cdr.end());
    samples.push_back(
        {message.time_ns, {}, {}, std::make_shared<const TopicMessage>(std::move(message))});
  }
  if (in.is_short() || in.left() > 0) return malformed("their lengths do not fit");
  return samples;
}

}  // namespace

std::string to_message_line(const TopicMessage& message) {
  return fmt::format("{},{},{},{:02x}\n", message.time_ns, message.publisher->topic,
                     message.publisher->type, fmt::join(message.cdr, ""));
}

std::string to_line(const Sample& sample) {
  return sample.message ? to_message_line(*sample.message) : to_euroc_line(sample);
}

std::string to_euroc_line(const Sample& sample) {
  const auto& [x, y, z] = sample.angular_velocity;
  const auto& [ax, ay, az] = sample.linear_acceleration;
  return fmt::format("{},{},{},{},{},{},{}\n", sample.time_ns, x, y, z, ax, ay, az);
}

std::optional<Sample> parse_euroc_line(std::string_view line) {
  Sample sample;
  bool is_sound = take_field(line, sample.time_ns, false) && sample.time_ns >= 0;
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
  if (!is_valid_id(stream.name)) return false;
  return stream.codec == kTopicCodec ||
         (stream.codec == kSampleCodec && stream.name.starts_with("imu"));
}

bool is_valid(const TopicPublisher& writer) {
  return is_name(writer.topic, "_/") && writer.topic.front() == '/' && writer.topic.back() != '/' &&
         is_name(writer.type, "_:") && writer.user_data.size() <= kMaxTopicTextBytes &&
         writer.depth > 0;
}

std::vector<std::uint8_t> encode_samples(std::span<const Sample> samples) {
  assert(!samples.empty() && samples.size() <= kMaxSamplesPerMessage);
  if (samples.front().message) return encode_messages(samples);
  Writer out(0);
  out.put(static_cast<std::uint16_t>(samples.size()));
  for (const Sample& sample : samples) fields(out, sample);
  return std::move(out.bytes());
}

Parsed<std::vector<Sample>> parse_samples(std::string_view codec,
                                          std::span<const std::uint8_t> payload) {
  Reader in(payload);
  const auto count = in.take<std::uint16_t>();
  const bool is_count = count > 0 && count <= kMaxSamplesPerMessage;
  if (is_count && codec == kTopicCodec) return parse_messages(in, count);
  if (!is_count || in.left() != count * kSampleBytes) {
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

Parsed<std::vector<Sample>> parse_samples(std::span<const StreamDeclaration> declared,
                                          StreamId stream, std::span<const std::uint8_t> payload) {
  const auto found = std::ranges::find(declared, stream, &StreamDeclaration::id);
  if (found != declared.end()) return parse_samples(found->codec, payload);
  return Fault{ErrorCode::kUnexpected, fmt::format("items of stream {}, not declared", stream)};
}

}  // namespace wire
}  // namespace orbbuf
