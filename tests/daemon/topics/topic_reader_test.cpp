// SPDX-License-Identifier: Apache-2.0
#include "daemon/topics/topic_reader.hpp"

#include <gmock/gmock.h>
#include <poll.h>

#include "testing/captured_log.hpp"
#include "testing/loopback_dds.hpp"
#include "tests/daemon/topics/topic_writer.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;
using test::TopicWriter;
using test::write_jpeg;
using testing::SizeIs;

const std::string kImageTopic = "/camera/image";

class TopicReaderTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { test::use_loopback_dds("78"); }

  void make(std::chrono::nanoseconds patience = TopicReader::kPatience) {
    reader_.emplace(
        kImageTopic,
        std::vector<const dds_topic_descriptor*>{&sensor_msgs_msg_dds__CompressedImage__desc,
                                                 &sensor_msgs_msg_dds__Image__desc},
        4, patience);
  }
  /// The seconds of the stamp of the next compressed image, 0 if there is none.
  int take() {
    const auto message = reader_->take();
    if (!message || message->type != 0) return 0;
    const auto* image =
        static_cast<const sensor_msgs_msg_dds__CompressedImage_*>(message->data.get());
    return image->header.stamp.sec;
  }
  bool is_readable(int timeout_ms) const {
    pollfd event{reader_->fd(), POLLIN, 0};
    return ::poll(&event, 1, timeout_ms) == 1;
  }

  std::optional<TopicReader> reader_;
};

TEST_F(TopicReaderTest, ReadsInOrderAndTellsWhenThereIsSomething) {
  make();
  EXPECT_EQ(take(), 0);
  EXPECT_FALSE(is_readable(0));
  const TopicWriter writer(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  EXPECT_TRUE(is_readable(60'000));  // the publisher
  EXPECT_EQ(take(), 0);
  write_jpeg(writer, 1, {1});
  write_jpeg(writer, 2, {2});
  EXPECT_TRUE(is_readable(60'000));
  EXPECT_EQ(take(), 1);
  EXPECT_EQ(take(), 2);
  EXPECT_EQ(take(), 0);
  EXPECT_FALSE(is_readable(0));
}

TEST_F(TopicReaderTest, ATakenMessageOutlivesTheReader) {
  make();
  const TopicWriter writer(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  EXPECT_EQ(take(), 0);
  write_jpeg(writer, 1, {7, 8});
  const auto message = reader_->take();
  ASSERT_TRUE(message);
  make();
  const auto* image =
      static_cast<const sensor_msgs_msg_dds__CompressedImage_*>(message->data.get());
  EXPECT_EQ(image->data._length, 2U);
  EXPECT_EQ(image->data._buffer[1], 8);
}

TEST_F(TopicReaderTest, IsAsReliableAsAllPublishersAre) {
  make();
  const TopicWriter first(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  EXPECT_EQ(take(), 0);
  EXPECT_EQ(first.reader(), TopicWriter::kReliable);
  {
    const TopicWriter second(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic,
                             TopicWriter::kBestEffort);
    EXPECT_EQ(take(), 0);
    EXPECT_EQ(first.reader(), TopicWriter::kBestEffort);
    EXPECT_EQ(second.reader(), TopicWriter::kBestEffort);
    write_jpeg(second, 3, {3});
    EXPECT_EQ(take(), 3);
  }
  EXPECT_EQ(take(), 0);
  EXPECT_EQ(first.reader(), TopicWriter::kReliable);
}

TEST_F(TopicReaderTest, MessagesOfAPublisherThatHasLeftAreRead) {
  make();
  {
    const TopicWriter writer(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
    EXPECT_EQ(take(), 0);
    write_jpeg(writer, 1, {1});
  }
  EXPECT_EQ(take(), 1);
  const TopicWriter another(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  EXPECT_EQ(take(), 0);
  write_jpeg(another, 2, {2});
  EXPECT_EQ(take(), 2);
}

TEST_F(TopicReaderTest, TheNewestMessagesWait) {
  make();
  const TopicWriter writer(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  EXPECT_EQ(take(), 0);
  for (int i = 1; i <= 6; ++i) write_jpeg(writer, i, {1});
  for (int i = 3; i <= 6; ++i) EXPECT_EQ(take(), i);
  EXPECT_EQ(take(), 0);
}

TEST_F(TopicReaderTest, TakesTheTypeThatIsPublished) {
  make();
  const TopicWriter writer(sensor_msgs_msg_dds__Image__desc, kImageTopic);
  EXPECT_FALSE(reader_->take());
  sensor_msgs_msg_dds__Image_ image{};
  std::string encoding = "mono8";
  image.header = test::header(1, 2);
  image.encoding = encoding.data();
  writer.write(&image);
  const auto message = reader_->take();
  ASSERT_TRUE(message);
  EXPECT_EQ(message->type, 1U);
}

TEST_F(TopicReaderTest, SaysOnceWhyThereIsNoMessage) {
  const test::CapturedLog log;
  make(0ns);
  EXPECT_EQ(take(), 0);
  EXPECT_EQ(take(), 0);
  EXPECT_THAT(log.lines("topic /camera/image: no message for 0 s: no program publishes it in "
                        "ROS_DOMAIN_ID 78 as sensor_msgs/msg/CompressedImage or "
                        "sensor_msgs/msg/Image; waiting"),
              SizeIs(1));
  {
    const TopicWriter other(sensor_msgs_msg_dds__Imu__desc, kImageTopic);
    EXPECT_EQ(take(), 0);
    EXPECT_THAT(log.lines("it is published as sensor_msgs/msg/Imu, not as"), SizeIs(1));
  }
  const TopicWriter writer(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  EXPECT_EQ(take(), 0);
  EXPECT_THAT(log.lines("its publisher sends nothing"), SizeIs(1));
  write_jpeg(writer, 1, {1});
  EXPECT_EQ(take(), 1);
  EXPECT_THAT(log.lines("messages again"), SizeIs(1));
}

TEST_F(TopicReaderTest, WithoutTypesMessagesOfAnyAreBytesAndNameTheirPublisher) {
  reader_.emplace(kImageTopic, TopicReader::Types{}, 4);
  const TopicWriter reliable(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  const TopicWriter best_effort(sensor_msgs_msg_dds__Image__desc, kImageTopic,
                                TopicWriter::kBestEffort);
  EXPECT_FALSE(reader_->take());
  EXPECT_EQ(reliable.reader(), TopicWriter::kReliable);
  EXPECT_EQ(best_effort.reader(), TopicWriter::kBestEffort);
  write_jpeg(reliable, 5, {7});
  const auto message = reader_->take();
  ASSERT_TRUE(message && message->raw);
  const TopicPublisher& publisher = *message->raw->publisher;
  EXPECT_EQ(publisher.topic, kImageTopic);
  EXPECT_EQ(publisher.type, "sensor_msgs::msg::dds_::CompressedImage_");
  EXPECT_TRUE(publisher.is_reliable);
  EXPECT_FALSE(publisher.is_latched);
  EXPECT_GT(message->raw->time_ns, 0);
  ASSERT_GT(message->raw->cdr.size(), 8U);
  EXPECT_EQ(message->raw->cdr[1], 1);  // little endian
  EXPECT_EQ(message->raw->cdr[4], 5);  // the stamp's seconds
  EXPECT_FALSE(reader_->take());
}

TEST_F(TopicReaderTest, WithoutTypesMessagesOfAPublisherThatHasLeftAreRead) {
  reader_.emplace(kImageTopic, TopicReader::Types{}, 4);
  {
    const TopicWriter writer(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
    EXPECT_FALSE(reader_->take());
    write_jpeg(writer, 1, {1});
  }
  EXPECT_TRUE(reader_->take());
  EXPECT_FALSE(reader_->take());
  const TopicWriter another(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  write_jpeg(another, 2, {2});  // before the reader has looked for it
  EXPECT_TRUE(reader_->take());
}

TEST_F(TopicReaderTest, APatternIsEachTopicThatBeginsSo) {
  reader_.emplace("/camera/*", TopicReader::Types{}, 4);
  const TopicWriter image(sensor_msgs_msg_dds__CompressedImage__desc, kImageTopic);
  const TopicWriter other(sensor_msgs_msg_dds__CompressedImage__desc, "/camera/right/image");
  const TopicWriter none(sensor_msgs_msg_dds__CompressedImage__desc, "/cameras");
  EXPECT_FALSE(reader_->take());
  for (const TopicWriter* writer : {&image, &other, &none}) write_jpeg(*writer, 1, {1});
  std::vector<std::string> topics;
  while (const auto message = reader_->take()) topics.push_back(message->raw->publisher->topic);
  EXPECT_THAT(topics, testing::UnorderedElementsAre(kImageTopic, "/camera/right/image"));
}

}  // namespace
}  // namespace orbbuf
