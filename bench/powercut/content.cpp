// SPDX-License-Identifier: Apache-2.0
#include "bench/powercut/content.hpp"

#include <array>
#include <memory>
#include <random>
#include <span>
#include <utility>

#include "common/crc32.hpp"
#include "common/drop_record.hpp"
#include "common/jpeg.hpp"
#include "common/sample.hpp"

namespace orbbuf::powercut {
namespace {

constexpr wire::StreamId kImu = wire::kFirstOther;
constexpr wire::StreamId kTopic = kImu + 1;
constexpr std::int64_t kStepNs = 5'000'000;

std::int64_t time_of(Sequence step) {
  return 1'600'000'000'000'000'000 + static_cast<std::int64_t>(step) * kStepNs;
}

std::uint64_t drops_before(Sequence step) {
  std::uint64_t drops = 0;
  for (Sequence i = 0; i < step; ++i) drops += Content::is_dropped(i) ? 1 : 0;
  return drops;
}

/// A small image with a comment of so many random bytes, at most 65,000.
void append_jpeg(std::size_t bytes, std::minstd_rand& random, std::vector<std::uint8_t>& out) {
  static const std::vector<std::uint8_t> kImage = [] {
    const std::array<std::uint8_t, 64> pixels{};
    return JpegCodec("powercut").encode({pixels.data(), 8, 8, 8, 1}, 80, false).value();
  }();
  const std::size_t length = bytes + 2;  // of the segment
  out.insert(out.end(), {0xFF, 0xD8, 0xFF, 0xFE, static_cast<std::uint8_t>(length >> 8),
                         static_cast<std::uint8_t>(length)});
  for (; bytes > 0; --bytes) out.push_back(static_cast<std::uint8_t>(random()));
  out.insert(out.end(), kImage.begin() + 2, kImage.end());
}

std::vector<Sample> samples_of(Sequence step) {
  const auto count = Content::items_a_step(kImu);
  std::vector<Sample> samples(count);
  for (std::uint64_t i = 0; i < count; ++i) {
    samples[i].time_ns = time_of(step) + static_cast<std::int64_t>(i) * kStepNs / 4;
    samples[i].angular_velocity = {static_cast<double>(step), static_cast<double>(i), 0.5};
  }
  return samples;
}

Sample message_of(Sequence step) {
  static const auto publisher = std::make_shared<const TopicPublisher>(
      TopicPublisher{1, "/odom", "nav_msgs::msg::dds_::Odometry_", "", 1, true});
  std::vector<std::uint8_t> cdr = {0, 1, 0, 0};
  cdr.resize(4 + step * 37 % 3000, static_cast<std::uint8_t>(step));
  Sample sample{time_of(step), {}, {}, {}};
  sample.message =
      std::make_shared<const TopicMessage>(TopicMessage{publisher, sample.time_ns, std::move(cdr)});
  return sample;
}

}  // namespace

std::vector<wire::StreamDeclaration> Content::streams() const {
  std::vector<wire::StreamDeclaration> streams = {{kImu, "imu", std::string(wire::kSampleCodec)}};
  if (is_stereo()) streams.push_back({kTopic, "odom", std::string(wire::kTopicCodec)});
  return streams;
}

std::uint64_t Content::items_a_step(wire::StreamId stream) { return stream == kImu ? 4 : 1; }

EncodedFrame Content::frame(Sequence step, bool is_reduced) const {
  std::minstd_rand random(
      static_cast<unsigned>(1 + static_cast<std::uint64_t>(robot_) * 1'000'003 + step));
  EncodedFrame frame;
  frame.sequence = step;
  frame.capture_time_ns = time_of(step);
  frame.width_px = 640;
  frame.height_px = 480;
  const std::size_t bytes = (2000 + random() % 60'000) / (is_reduced ? 3 : 1);
  append_jpeg(bytes, random, frame.jpeg);
  frame.left_bytes = static_cast<std::uint32_t>(frame.jpeg.size());
  if (is_stereo()) append_jpeg(bytes / 2, random, frame.jpeg);
  frame.jpeg_crc = crc32(frame.jpeg);
  return frame;
}

EncodedFrame Content::live(Sequence step) const {
  EncodedFrame whole = frame(step, false);
  if (!is_reduced(step)) return whole;
  EncodedFrame reduced = frame(step, true);
  reduced.quality = 30;
  reduced.whole_bytes = static_cast<std::uint32_t>(whole.jpeg.size());
  reduced.whole_crc = whole.jpeg_crc;
  return reduced;
}

std::vector<wire::Items> Content::items(Sequence step) const {
  std::vector<wire::Items> items;
  if (is_dropped(step)) {
    const std::array drop = {DropRecord{step, time_of(step)}};
    items.push_back({wire::kDrops, drops_before(step), wire::encode_drops(drop)});
  }
  for (const wire::StreamDeclaration& stream : streams()) {
    items.push_back({stream.id, step * items_a_step(stream.id),
                     wire::encode_samples(stream.id == kImu ? samples_of(step)
                                                            : std::vector{message_of(step)})});
  }
  return items;
}

std::vector<Content::Late> Content::lates(Sequence step) const {
  std::vector<Late> lates;
  for (wire::Items& each : items(step)) {
    if (are_late(each, step)) lates.push_back({step, std::move(each)});
  }
  const bool is_spooled = is_dropped(step) && step % 2 == 1;
  if (is_spooled || is_reduced(step)) lates.push_back({step, std::nullopt});
  return lates;
}

}  // namespace orbbuf::powercut
