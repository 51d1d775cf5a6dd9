// SPDX-License-Identifier: Apache-2.0
#include "common/sample.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace orbbuf {
namespace {

Sample sample_of(std::int64_t time_ns) {
  return {time_ns, {0.1, -1e-9, 3}, {9.81, 1.0 / 3, -2e300}};
}

TEST(Sample, ALineReadsBackTheSame) {
  const std::string line = to_euroc_line(sample_of(1403636579758555392));
  ASSERT_TRUE(line.ends_with('\n'));
  EXPECT_EQ(parse_euroc_line(line.substr(0, line.size() - 1)), sample_of(1403636579758555392));
}

TEST(Sample, TheDataSetsOwnLinesAreRead) {
  const auto sample = parse_euroc_line("5, -0.5,0.25,1e-1 ,8,0,-1\r");
  EXPECT_EQ(sample, (Sample{5, {-0.5, 0.25, 0.1}, {8, 0, -1}}));
}

TEST(Sample, OtherLinesAreNone) {
  for (const char* line : {"", "#timestamp", "1,2,3,4,5,6", "1,2,3,4,5,6,7,8", "1,2,3,4,5,6,nan",
                           "1,2,3,,5,6,7", "1.5,2,3,4,5,6,7", "1,2,3,4,5,6,7x", "-1,2,3,4,5,6,7"}) {
    EXPECT_FALSE(parse_euroc_line(line)) << line;
  }
}

TEST(Sample, APayloadReadsBackTheSame) {
  const std::vector<Sample> samples = {sample_of(-1), sample_of(7)};
  const auto payload = wire::encode_samples(samples);
  EXPECT_EQ(payload.size(), 2U + 2U * 56U);
  EXPECT_EQ(wire::parse_samples(wire::kSampleCodec, payload).value(), samples);
}

TEST(Sample, APayloadThatIsCutOrLongerOrNotFiniteIsRefused) {
  const std::vector<Sample> samples = {sample_of(1)};
  auto payload = wire::encode_samples(samples);
  for (std::size_t bytes = 0; bytes < payload.size(); ++bytes) {
    EXPECT_FALSE(wire::parse_samples(wire::kSampleCodec, std::span(payload).first(bytes))) << bytes;
  }
  payload.push_back(0);
  EXPECT_FALSE(wire::parse_samples(wire::kSampleCodec, payload));
  const std::vector<Sample> infinite = {
      {1, {0, 0, std::numeric_limits<double>::infinity()}, {0, 0, 0}}};
  EXPECT_FALSE(wire::parse_samples(wire::kSampleCodec, wire::encode_samples(infinite)));
}

/// A message of `bytes` bytes.
Sample message_of(std::int64_t time_ns, std::uint64_t key, std::size_t bytes) {
  const TopicPublisher publisher{key,   "/odom", "nav_msgs::msg::dds_::Odometry_", "a=b;", 3, true,
                                 false, true};
  return {time_ns,
          {},
          {},
          std::make_shared<const TopicMessage>(
              TopicMessage{std::make_shared<const TopicPublisher>(publisher), time_ns,
                           std::vector<std::uint8_t>(bytes, static_cast<std::uint8_t>(key))})};
}

TEST(Sample, MessagesOfTopicsReadBackTheSame) {
  const std::vector<Sample> samples = {message_of(-1, 1, 4), message_of(7, 2, 5),
                                       message_of(7, 1, 1000)};
  const auto payload = wire::encode_samples(samples);
  const auto again = wire::parse_samples(wire::kTopicCodec, payload);
  ASSERT_TRUE(again);
  ASSERT_EQ(again.value().size(), samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const TopicMessage& message = *again.value()[i].message;
    EXPECT_EQ(*message.publisher, *samples[i].message->publisher);
    EXPECT_EQ(message.cdr, samples[i].message->cdr);
    EXPECT_EQ(message.time_ns, samples[i].time_ns);
    EXPECT_EQ(again.value()[i].time_ns, samples[i].time_ns);
  }
  EXPECT_EQ(wire::encode_samples(again.value()), payload);
}

TEST(Sample, MessagesThatAreCutOrLongerOrOfNoPublisherAreRefused) {
  const std::vector<Sample> samples = {message_of(1, 1, 4), message_of(2, 2, 5)};
  auto payload = wire::encode_samples(samples);
  for (std::size_t bytes = 0; bytes < payload.size(); ++bytes) {
    EXPECT_FALSE(wire::parse_samples(wire::kTopicCodec, std::span(payload).first(bytes))) << bytes;
  }
  payload.push_back(0);
  EXPECT_FALSE(wire::parse_samples(wire::kTopicCodec, payload));
  payload.pop_back();
  payload[payload.size() - 1 - 5 - 4 - 8] = 2;  // the second one's publisher
  EXPECT_FALSE(wire::parse_samples(wire::kTopicCodec, payload));
}

TEST(Sample, AMessageHasTheHeaderOfCdr) {
  const std::vector<Sample> samples = {message_of(1, 1, 3)};
  EXPECT_FALSE(wire::parse_samples(wire::kTopicCodec, wire::encode_samples(samples)));
}

TEST(Sample, APayloadIsReadByTheCodecOfItsStream) {
  const std::vector<wire::StreamDeclaration> declared = {{4, "imu0", "imu"}, {6, "odom", "ros2"}};
  const auto samples = wire::encode_samples(std::vector<Sample>{sample_of(1)});
  const auto messages = wire::encode_samples(std::vector<Sample>{message_of(1, 1, 4)});
  EXPECT_TRUE(wire::parse_samples(declared, 4, samples));
  EXPECT_TRUE(wire::parse_samples(declared, 6, messages));
  EXPECT_FALSE(wire::parse_samples(declared, 4, messages));
  EXPECT_FALSE(wire::parse_samples(declared, 6, samples));
  EXPECT_FALSE(wire::parse_samples(declared, 5, samples));
}

TEST(Sample, APublisherHasTheNamesThatRos2Allows) {
  const TopicPublisher sound = *message_of(0, 1, 0).message->publisher;
  EXPECT_TRUE(wire::is_valid(sound));
  const auto with = [&sound](auto change) {
    TopicPublisher publisher = sound;
    change(publisher);
    return wire::is_valid(publisher);
  };
  for (const char* topic : {"", "odom", "/odom/", "/a b", "/a\n", "/a%n"}) {
    EXPECT_FALSE(with([topic](auto& each) { each.topic = topic; })) << topic;
  }
  for (const char* type : {"", "a b", "a,b"}) {
    EXPECT_FALSE(with([type](auto& each) { each.type = type; })) << type;
  }
  EXPECT_FALSE(with([](auto& each) { each.depth = 0; }));
  EXPECT_FALSE(with([](auto& each) { each.user_data.resize(wire::kMaxTopicTextBytes + 1); }));
}

TEST(Sample, AMessageHasALineOfItsOwn) {
  EXPECT_EQ(to_line(message_of(5, 0xAB, 2)), "5,/odom,nav_msgs::msg::dds_::Odometry_,abab\n");
  EXPECT_EQ(to_line(sample_of(5)), to_euroc_line(sample_of(5)));
}

TEST(Sample, AStreamsNameIsSafeAsAFolderBesideTheImages) {
  EXPECT_TRUE(wire::is_sample_stream({4, "imu0", "imu"}));
  for (const char* name : {"images", "orphans", "../imu", "imu/..", "", "imu 0"}) {
    EXPECT_FALSE(wire::is_sample_stream({4, name, "imu"})) << name;
  }
  EXPECT_FALSE(wire::is_sample_stream({4, "imu0", "other"}));
  EXPECT_TRUE(wire::is_sample_stream({4, "images", "ros2"}));  // in topics/
  EXPECT_FALSE(wire::is_sample_stream({4, "../imu", "ros2"}));
}

}  // namespace
}  // namespace orbbuf
