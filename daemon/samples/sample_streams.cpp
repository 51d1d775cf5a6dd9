// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_streams.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

#include "common/log.hpp"
#include "daemon/capture/camera_source.hpp"
#include "daemon/samples/euroc_samples.hpp"
#include "daemon/samples/generated_samples.hpp"
#include "daemon/samples/iio_samples.hpp"
#ifdef ORBBUF_DAEMON_DDS
#include "daemon/samples/ros2_samples.hpp"
#endif
#include "daemon/samples/socket_samples.hpp"

namespace orbbuf {
namespace {

bool is_of_topic(const SampleStreamSettings& settings) { return settings.kind == "topic"; }

}  // namespace

std::unique_ptr<SampleSource> make_sample_source(boost::asio::io_context& main,
                                                 const SampleStreamSettings& settings,
                                                 SampleSource::Take take) {
  if (settings.kind == "socket") {
    return std::make_unique<SocketSamples>(main, settings, std::move(take));
  }
  if (settings.kind == "iio") {
    return std::make_unique<IioSamples>(main, settings, std::move(take));
  }
  if (settings.kind == "generated") {
    return std::make_unique<GeneratedSamples>(main, std::move(take));
  }
  if (settings.kind == "ros2" || is_of_topic(settings)) {
#ifdef ORBBUF_DAEMON_DDS
    return std::make_unique<Ros2Samples>(main, settings, std::move(take));
#else
    throw std::runtime_error(
        fmt::format("{}: cannot read a ROS 2 topic: orbbufd was built without DDS (cmake "
                    "-DORBBUF_WITH_DDS=ON)",
                    settings.name));
#endif
  }
  return std::make_unique<EurocSamples>(settings.path, std::move(take));
}

SampleStreams::SampleStreams(boost::asio::io_context& main,
                             const std::vector<SampleStreamSettings>& settings,
                             std::function<void()> on_due)
    : on_due_(std::move(on_due)) {
  wire::StreamId id = wire::kFirstOther;
  streams_.reserve(settings.size());
  for (const SampleStreamSettings& each : settings) {
    const auto codec = is_of_topic(each) ? wire::kTopicCodec : wire::kSampleCodec;
    Stream& stream =
        streams_.emplace_back(Stream{{id++, each.name, std::string(codec)},
                                     SampleQueue(each.memory_bytes, each.policy, each.frame_time),
                                     StampClock(each.name, "the sample is lost")});
    stream.has_system_time = is_of_topic(each) || each.kind == "ros2" || each.kind == "socket";
    stream.is_of_driver = each.kind == "ros2" || each.kind == "socket" || each.kind == "iio";
    stream.source = make_sample_source(
        main, each, [this, &stream](const Sample& sample) { take(stream, sample); });
  }
}

void SampleStreams::take(Stream& stream, Sample sample) {
  if (stream.is_of_driver && session_time_ && !has_frames_) return;
  if (stream.has_system_time && session_time_) sample.time_ns = session_time_(sample.time_ns);
  if (stream.queue.policy() == TopicPolicy::kFrames) sample.time_ns -= frames_step_ns_;
  if (stream.is_of_driver) {
    const auto time_ns = stream.stamps.fit(sample.time_ns, read_clocks().since_boot_ns());
    if (!time_ns) return stream.queue.refuse();
    sample.time_ns = *time_ns;
  }
  const bool had_batch = has_batch(stream);
  if (stream.queue.push(sample)) {
    stream.newest = EventRate::Clock::now();
    stream.rate.count(1, stream.newest);
  } else if (!std::exchange(stream.is_refusal_logged, true)) {
    log_warn("{}: {}, and so are others like it", stream.declaration.name,
             sample.message ? fmt::format("a message of {} bytes is lost: at most {} can be sent",
                                          sample.message->cdr.size(), wire::kMaxTopicMessageBytes)
                            : "a sample is lost: it is not newer than the one before");
  }
  if (!had_batch && has_batch(stream)) on_due_();
}

/// Messages of topics are fewer than samples, and one waits for no other.
bool SampleStreams::has_batch(const Stream& stream) {
  const bool is_due = stream.declaration.codec == wire::kTopicCodec
                          ? stream.queue.has_due()
                          : std::chrono::nanoseconds(stream.queue.unsent_ns()) >= kBatch;
  return stream.is_taken && is_due;
}

std::vector<wire::StreamDeclaration> SampleStreams::declarations() const {
  std::vector<wire::StreamDeclaration> all;
  for (const Stream& stream : streams_) all.push_back(stream.declaration);
  return all;
}

void SampleStreams::on_frame(std::int64_t time_ns) {
  has_frames_ = true;
  const std::int64_t frames_delay_ns = read_clocks().since_boot_ns() - time_ns;
  for (Stream& stream : streams_) {
    stream.stamps.expect_delay(frames_delay_ns);
    if (stream.source) stream.source->on_frame(time_ns);
  }
}

void SampleStreams::on_frame_sent(std::int64_t time_ns) {
  for (Stream& stream : streams_) stream.queue.on_frame_sent(time_ns);
}

void SampleStreams::on_frames_dropped(const std::vector<DropRecord>& drops) {
  for (Stream& stream : streams_) {
    for (const DropRecord& drop : drops) {
      stream.queue.on_frames_dropped(drop.capture_time_ns, drop.capture_time_of(drop.end() - 1));
    }
  }
}

void SampleStreams::on_last_frame_sent() {
  for (Stream& stream : streams_) stream.queue.on_last_frame_sent();
}

void SampleStreams::stop() {
  for (Stream& stream : streams_) stream.source.reset();
}

void SampleStreams::on_connected(const wire::Position& position,
                                 const std::function<bool(wire::StreamId)>& takes) {
  for (Stream& stream : streams_) {
    stream.queue.rewind(position[stream.declaration.id]);
    stream.is_taken = takes(stream.declaration.id);
    if (!stream.is_taken) {
      log_warn("link: the server does not take the stream {}", stream.declaration.name);
    }
    const std::uint64_t lost = stream.queue.lost() - stream.queue.refused();
    if (stream.queue.policy() != TopicPolicy::kAll) continue;  // what the policy gave up
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

std::optional<wire::Items> SampleStreams::take_message(std::int64_t upto_ns) {
  for (Stream& stream : streams_) {
    if (auto items = take_from(stream, upto_ns)) return items;
  }
  return std::nullopt;
}

std::optional<wire::Items> SampleStreams::take_batch(EventRate::Time now) {
  const auto due = std::ranges::find_if(streams_, [now](const Stream& stream) {
    const bool is_left = stream.queue.has_due() && now - stream.newest >= kBatch;
    return has_batch(stream) || (stream.is_taken && is_left);
  });
  if (due == streams_.end()) return std::nullopt;
  return take_from(*due, std::numeric_limits<std::int64_t>::max());
}

std::optional<wire::Items> SampleStreams::take_from(Stream& stream, std::int64_t upto_ns) {
  const auto batch = stream.is_taken ? stream.queue.take(upto_ns) : std::nullopt;
  if (!batch) return std::nullopt;
  return wire::Items{stream.declaration.id, batch->first, wire::encode_samples(batch->samples)};
}

bool SampleStreams::is_settled() const {
  return std::ranges::all_of(
      streams_, [](const Stream& stream) { return !stream.is_taken || stream.queue.is_settled(); });
}

std::vector<SampleStreams::Progress> SampleStreams::record(
    const std::function<bool(const wire::Items&)>& keep, const SendLate& send_late) {
  std::vector<Progress> all;
  for (Stream& stream : streams_) {
    const wire::StreamDeclaration& declaration = stream.declaration;
    SampleQueue& queue = stream.queue;
    for (;;) {
      const SampleQueue::Batch batch = queue.unrecorded();
      if (batch.samples.empty()) break;
      if (!keep({declaration.id, batch.first, wire::encode_samples(batch.samples)})) break;
      queue.set_recorded(batch.first + batch.samples.size());
    }
    for (const SampleQueue::Range& late : queue.take_late()) {
      queue.lose_late(send_late(declaration.id, late));
    }
    all.push_back({declaration, queue.captured(), queue.first_waiting()});
  }
  return all;
}

void SampleStreams::put_ends(wire::Position& position) const {
  for (const Stream& stream : streams_) {
    position[stream.declaration.id] = stream.queue.sent_end();
  }
}

wire::Position SampleStreams::captured() const {
  wire::Position position;
  for (const Stream& stream : streams_) {
    position[stream.declaration.id] = stream.queue.captured();
  }
  return position;
}

std::string SampleStreams::stats(EventRate::Time now) const {
  std::string text;
  for (const Stream& stream : streams_) {
    const SampleQueue& queue = stream.queue;
    text += fmt::format("{}{} captured {} = delivered {} + late {} + waiting {} + lost {}",
                        text.empty() ? "" : "; ", stream.declaration.name, queue.captured(),
                        queue.delivered(), queue.late(), queue.waiting(), queue.lost());
    if (!stream.source || queue.captured() == 0) continue;
    const auto age = std::chrono::duration_cast<std::chrono::milliseconds>(now - stream.newest);
    text += fmt::format(", {:.1f}/s, newest {} ms old", stream.rate.per_second(now), age.count());
  }
  return text;
}

}  // namespace orbbuf
