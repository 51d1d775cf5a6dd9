// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_streams.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/log.hpp"
#include "daemon/samples/euroc_samples.hpp"

namespace orbbuf {

SampleStreams::SampleStreams(const std::vector<SampleStreamSettings>& settings) {
  wire::StreamId id = wire::kFirstOther;
  for (const SampleStreamSettings& each : settings) {
    streams_.push_back({{id++, each.name, std::string(wire::kSampleCodec)},
                        std::make_unique<EurocSamples>(each.path),
                        SampleQueue(each.memory_bytes)});
  }
}

std::vector<wire::StreamDeclaration> SampleStreams::declarations() const {
  std::vector<wire::StreamDeclaration> all;
  for (const Stream& stream : streams_) all.push_back(stream.declaration);
  return all;
}

void SampleStreams::capture_until(std::int64_t time_ns) {
  for (Stream& stream : streams_) {
    stream.source->read_until(time_ns,
                              [&stream](const Sample& sample) { stream.queue.push(sample); });
  }
}

void SampleStreams::on_connected(const wire::Position& position, const std::vector<bool>& takes) {
  for (std::size_t i = 0; i < streams_.size(); ++i) {
    Stream& stream = streams_[i];
    stream.queue.rewind(position[stream.declaration.id]);
    stream.is_taken = takes.at(i);
    if (!stream.is_taken) {
      log_warn("link: the server does not take the stream {}", stream.declaration.name);
    }
    const std::uint64_t lost = stream.queue.lost();
    if (lost > std::exchange(stream.lost_logged, lost)) {
      log_warn(
          "{}: {} samples are lost so far: more were captured in an outage than its memory "
          "holds",
          stream.declaration.name, lost);
    }
  }
}

void SampleStreams::on_ack(const wire::Position& position) {
  for (Stream& stream : streams_) stream.queue.acknowledge(position[stream.declaration.id]);
}

bool SampleStreams::can_be_at(const wire::Position& position) const {
  return std::ranges::all_of(streams_, [&](const Stream& stream) {
    return position[stream.declaration.id] <= stream.queue.sent_end();
  });
}

std::vector<std::uint8_t> SampleStreams::take_message(std::int64_t upto_ns) {
  for (Stream& stream : streams_) {
    if (!stream.is_taken) continue;
    if (const auto batch = stream.queue.take(upto_ns)) {
      return wire::encode(
          wire::Items{stream.declaration.id, batch->first, wire::encode_samples(batch->samples)});
    }
  }
  return {};
}

bool SampleStreams::is_settled() const {
  return std::ranges::all_of(
      streams_, [](const Stream& stream) { return !stream.is_taken || stream.queue.is_settled(); });
}

void SampleStreams::put_ends(wire::Position& position) const {
  for (const Stream& stream : streams_) {
    position[stream.declaration.id] = stream.queue.sent_end();
  }
}

std::string SampleStreams::stats() const {
  std::string text;
  for (const auto& [declaration, source, queue, is_taken, lost_logged] : streams_) {
    text += fmt::format("{}{} captured {} = delivered {} + waiting {} + lost {}",
                        text.empty() ? "" : ", ", declaration.name, queue.captured(),
                        queue.delivered(), queue.waiting(), queue.lost());
  }
  return text;
}

}  // namespace orbbuf
