// SPDX-License-Identifier: Apache-2.0
#include "common/dds/dds_node.hpp"

#include <dds/dds.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <string>

#include "common/dds/dds_camera.hpp"
#include "common/dds/type_hash.hpp"
#include "testing/loopback_dds.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;

const std::string kType = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";

class DdsNodeTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { test::use_loopback_dds("77"); }
  void SetUp() override {
    participant_.emplace();
    camera_.emplace(*participant_, "robot", "cam");
    node_.emplace(*participant_, "orbbuf", [this] { ++looks_; });
  }
  void TearDown() override {
    node_.reset();
    camera_.reset();
    participant_.reset();
  }

  /// As every node of ROS 2 has one.
  int read(bool has_hash) {
    ros2_ = dds_create_participant(77, nullptr, nullptr);
    const RawTopic topic(ros2_, "ros_discovery_info", kType);
    dds_qos_t* const qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
    if (has_hash) set_type_hash(qos, kType);
    const dds_entity_t reader = dds_create_reader(ros2_, topic.entity(), qos, nullptr);
    dds_delete_qos(qos);
    return reader;
  }

  /// The message about those writers.
  Bytes expected(std::size_t id_bytes, const std::vector<int>& writers) const {
    Bytes bytes{0, 1, 0, 0};
    const auto add = [&](const Bytes& more) {
      bytes.insert(bytes.end(), more.begin(), more.end());
    };
    const auto add_id = [&](int entity) {
      dds_guid_t guid;
      dds_get_guid(entity, &guid);
      Bytes id(std::begin(guid.v), std::end(guid.v));
      id.resize(id_bytes);
      add(id);
    };
    add_id(participant_->entity());
    add({1, 0, 0, 0});
    add({2, 0, 0, 0, '/', 0, 0, 0});
    add({7, 0, 0, 0, 'o', 'r', 'b', 'b', 'u', 'f', 0, 0});
    add({0, 0, 0, 0});  // readers
    add({static_cast<std::uint8_t>(writers.size()), 0, 0, 0});
    for (const int writer : writers) add_id(writer);
    return bytes;
  }

  std::atomic<int> looks_ = 0;
  std::optional<DdsParticipant> participant_;
  std::optional<DdsCamera> camera_;
  std::optional<DdsNode> node_;
  int ros2_ = 0;
};

TEST_F(DdsNodeTest, AReaderLearnsTheNodeAndItsWritersOnceEach) {
  EXPECT_FALSE(node_->tell());
  const int reader = read(true);
  EXPECT_GT(looks_, 0);
  EXPECT_FALSE(take_raw(reader));
  EXPECT_FALSE(node_->tell());
  EXPECT_FALSE(node_->tell());
  auto writers = writers_of(participant_->entity());
  ASSERT_EQ(writers.size(), 4U);
  std::erase(writers, node_->writer());
  EXPECT_EQ(take_raw(reader).value().cdr, expected(16, writers));
  EXPECT_FALSE(take_raw(reader));
  camera_.reset();
  EXPECT_FALSE(node_->tell());
  EXPECT_EQ(take_raw(reader).value().cdr, expected(16, {}));
}

TEST_F(DdsNodeTest, ReadersUpToHumbleGetLongerIds) {
  camera_.reset();
  const int reader = read(false);
  EXPECT_FALSE(node_->tell());
  EXPECT_EQ(take_raw(reader).value().cdr, expected(24, {}));
}

TEST(TypeHash, IsAnnouncedOfTypesThatAreKnown) {
  dds_qos_t* const qos = dds_create_qos();
  set_type_hash(qos, "any::msg::dds_::Other_");
  EXPECT_FALSE(has_type_hash(qos));
  set_type_hash(qos, "sensor_msgs::msg::dds_::Imu_");
  EXPECT_TRUE(has_type_hash(qos));
  void* data = nullptr;
  std::size_t size = 0;
  dds_qget_userdata(qos, &data, &size);
  EXPECT_EQ(std::string(static_cast<char*>(data), size),
            "typehash=RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b;");
  dds_free(data);
  dds_delete_qos(qos);
}

}  // namespace
}  // namespace orbbuf
