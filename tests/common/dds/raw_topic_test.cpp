// SPDX-License-Identifier: Apache-2.0
#include "common/dds/raw_topic.hpp"

#include <dds/dds.h>
#include <gtest/gtest.h>

#include "common/dds/dds_participant.hpp"
#include "testing/loopback_dds.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;

class RawTopicTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { test::use_loopback_dds("79"); }

  dds_entity_t make_reader(const RawTopic& topic) const {
    dds_qos_t* const qos = dds_create_qos();
    dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
    const dds_entity_t reader =
        dds_create_reader(participant_.entity(), topic.entity(), qos, nullptr);
    dds_delete_qos(qos);
    return require_dds(reader, "read");
  }

  const DdsParticipant participant_;
};

TEST_F(RawTopicTest, BytesOfAnyLengthArriveWithTheirTimeAndTheirWriter) {
  const RawTopic topic(participant_.entity(), "rt/any", "pkg::msg::dds_::Any_");
  const dds_entity_t reader = make_reader(topic);
  const dds_entity_t writer = require_dds(
      dds_create_writer(participant_.entity(), topic.entity(), nullptr, nullptr), "write");
  dds_instance_handle_t handle = 0;
  dds_get_instance_handle(writer, &handle);
  EXPECT_FALSE(take_raw(reader));
  for (const std::size_t size : {4U, 5U, 6U, 7U, 8U, 100'003U}) {
    Bytes cdr(size, 9);
    cdr[1] = 1;  // little endian
    EXPECT_EQ(topic.write(writer, cdr, static_cast<std::int64_t>(size)), 0);
    const auto message = take_raw(reader);
    ASSERT_TRUE(message);
    EXPECT_EQ(message->cdr, cdr);
    EXPECT_EQ(message->time_ns, static_cast<std::int64_t>(size));
    EXPECT_EQ(message->writer, handle);
  }
  EXPECT_FALSE(take_raw(reader));
}

TEST_F(RawTopicTest, ATopicMayBeMadeTwice) {
  const RawTopic topic(participant_.entity(), "rt/any", "pkg::msg::dds_::Any_");
  const dds_entity_t reader = make_reader(topic);
  const RawTopic again(participant_.entity(), "rt/any", "pkg::msg::dds_::Any_");
  const dds_entity_t writer = require_dds(
      dds_create_writer(participant_.entity(), again.entity(), nullptr, nullptr), "write");
  EXPECT_EQ(again.write(writer, Bytes{0, 1, 0, 0, 5, 6, 7, 8}, 1), 0);
  EXPECT_TRUE(take_raw(reader));
}

TEST_F(RawTopicTest, ANameThatIsNoneIsRefused) {
  EXPECT_THROW(RawTopic(participant_.entity(), "not a name", "any"), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf
