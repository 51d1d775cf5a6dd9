// SPDX-License-Identifier: Apache-2.0
// A ROS 2 node of one thread by Fast DDS, which is another implementation than the server's:
// `orbbuf-fast-dds-topic-tap PREFIX DEPTH MS`. It reads a TurtleBot3's topics behind the prefix
// with queues of that depth, and works so long at each image. Says `NAME SOURCE_TIME` of each
// message, `camera STAMP` of each image.
#include <ros_messagesPubSubTypes.h>
#include <topicsPubSubTypes.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fastdds/dds/core/condition/StatusCondition.hpp>
#include <fastdds/dds/core/condition/WaitSet.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace {

namespace fast = eprosima::fastdds::dds;

template <class Entity>
Entity* require(Entity* entity) {
  if (entity != nullptr) return entity;
  std::fputs("Fast DDS refuses\n", stderr);
  std::exit(1);
}

std::int64_t time_ns_of(const fast::SampleInfo& info) { return info.source_timestamp.to_ns(); }

class Node {
 public:
  Node(std::string prefix, int depth) : prefix_(std::move(prefix)), depth_(depth) {}

  template <class Message, class MessageType>
  void read(const std::string& name, bool is_reliable) {
    fast::DataReader* const reader = make_reader(new MessageType, name, is_reliable);
    takes_.push_back([reader, name] {
      Message message;
      fast::SampleInfo info;
      if (reader->take_next_sample(&message, &info) != ReturnCode_t::RETCODE_OK) return false;
      if (info.valid_data) {
        std::printf("%s %lld\n", name.c_str(), static_cast<long long>(time_ns_of(info)));
      }
      return true;
    });
  }

  [[noreturn]] void run(std::chrono::milliseconds work) {
    using Image = sensor_msgs::msg::dds_::CompressedImage_;
    fast::DataReader* const images = make_reader(
        new sensor_msgs::msg::dds_::CompressedImage_PubSubType, "image_raw/compressed", true);
    std::puts("ready");
    for (;;) {
      std::fflush(stdout);
      bool is_idle = true;
      for (const auto& take : takes_) is_idle = !take() && is_idle;
      Image image;
      fast::SampleInfo info;
      if (images->take_next_sample(&image, &info) == ReturnCode_t::RETCODE_OK) {
        const auto& stamp = image.header().stamp();
        std::printf("camera %lld\n", stamp.sec() * 1'000'000'000LL + stamp.nanosec());
        std::this_thread::sleep_for(work);
      } else if (is_idle) {
        fast::ConditionSeq ready;
        news_.wait(ready, eprosima::fastrtps::Duration_t(1, 0));
      }
    }
  }

 private:
  fast::DataReader* make_reader(fast::TopicDataType* message_type, const std::string& name,
                                bool is_reliable) {
    const fast::TypeSupport type(message_type);
    type.register_type(participant_);
    auto* const topic = require(participant_->create_topic(
        "rt" + prefix_ + "/" + name, type.get_type_name(), fast::TOPIC_QOS_DEFAULT));
    fast::DataReaderQos qos;
    qos.reliability().kind =
        is_reliable ? fast::RELIABLE_RELIABILITY_QOS : fast::BEST_EFFORT_RELIABILITY_QOS;
    qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = name == "tf" ? 10 * depth_ : depth_;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    auto* const reader = require(subscriber_->create_datareader(topic, qos));
    auto& condition = reader->get_statuscondition();
    condition.set_enabled_statuses(fast::StatusMask::data_available());
    news_.attach_condition(condition);
    return reader;
  }

  const std::string prefix_;
  const int depth_;
  fast::DomainParticipant* const participant_ =
      require(fast::DomainParticipantFactory::get_instance()->create_participant(
          0, fast::PARTICIPANT_QOS_DEFAULT));
  fast::Subscriber* const subscriber_ =
      require(participant_->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT));
  fast::WaitSet news_;
  std::vector<std::function<bool()>> takes_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  Node node(argv[1], std::atoi(argv[2]));
  node.read<tf2_msgs::msg::dds_::TFMessage_, tf2_msgs::msg::dds_::TFMessage_PubSubType>("tf", true);
  node.read<nav_msgs::msg::dds_::Odometry_, nav_msgs::msg::dds_::Odometry_PubSubType>("odom", true);
  node.read<sensor_msgs::msg::dds_::Imu_, sensor_msgs::msg::dds_::Imu_PubSubType>("imu", true);
  node.read<sensor_msgs::msg::dds_::LaserScan_, sensor_msgs::msg::dds_::LaserScan_PubSubType>(
      "scan", false);
  node.run(std::chrono::milliseconds(std::atoi(argv[3])));
}
