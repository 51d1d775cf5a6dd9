// SPDX-License-Identifier: Apache-2.0
// bench/dds/topic_writer.cpp by Fast DDS, which is another implementation than orbbufd's:
// `orbbuf-fast-dds-topic-writer SECONDS READERS JPEG...`.
#include <ros_messagesPubSubTypes.h>
#include <topicsPubSubTypes.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <random>
#include <string>
#include <thread>
#include <vector>

namespace {

namespace fast = eprosima::fastdds::dds;
using Clock = std::chrono::steady_clock;
using nav_msgs::msg::dds_::Odometry_;
using sensor_msgs::msg::dds_::CompressedImage_;
using sensor_msgs::msg::dds_::Imu_;
using sensor_msgs::msg::dds_::LaserScan_;
using tf2_msgs::msg::dds_::TFMessage_;

template <class Entity>
Entity* require(Entity* entity) {
  if (entity != nullptr) return entity;
  std::fputs("Fast DDS refuses\n", stderr);
  std::exit(1);
}

double any() {
  static std::mt19937_64 random(1);
  return std::uniform_real_distribution<double>(-1, 1)(random);
}

void fill(Odometry_& odom) {
  odom.child_frame_id("base_footprint");
  for (double& each : odom.pose().covariance()) each = any();
  odom.twist().twist().linear().x(any());
}

void fill(LaserScan_& scan) {
  scan.ranges().resize(360);
  for (float& each : scan.ranges()) each = static_cast<float>(any());
}

void fill(TFMessage_& message) {
  message.transforms().resize(1 + (any() > 0 ? 1 : 0));
  for (auto& each : message.transforms()) {
    each.child_frame_id("base_footprint");
    each.transform().translation().x(any());
  }
}

void fill(Imu_& imu) { imu.angular_velocity().x(any()); }

std::vector<std::vector<std::uint8_t>> images;

/// Each its stamp.
void fill(CompressedImage_& image) {
  static std::size_t next = 0;
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto seconds = std::chrono::floor<std::chrono::seconds>(now);
  image.header().stamp().sec(static_cast<std::int32_t>(seconds.count()));
  image.header().stamp().nanosec(
      static_cast<std::uint32_t>(std::chrono::nanoseconds(now - seconds).count()));
  image.format("jpeg");
  image.data(images[next++ % images.size()]);
}

struct Writer {
  std::string name;
  fast::DataWriter* writer;
  std::function<void()> write;
  std::chrono::nanoseconds period;  // 0: it writes once
  Clock::time_point due{};
  int written = 0;
};

class Writers {
 public:
  template <class Message, class MessageType>
  void add(const std::string& name, int per_second, bool is_reliable, std::string topic_as = "") {
    if (topic_as.empty()) topic_as = name;
    const fast::TypeSupport type(new MessageType);
    type.register_type(participant_);
    auto*& topic = topics_[name];
    if (topic == nullptr) {
      topic = require(participant_->create_topic("rt/" + topic_as, type.get_type_name(),
                                                 fast::TOPIC_QOS_DEFAULT));
    }
    fast::DataWriterQos qos;
    qos.reliability().kind =
        is_reliable ? fast::RELIABLE_RELIABILITY_QOS : fast::BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind =
        per_second == 0 ? fast::TRANSIENT_LOCAL_DURABILITY_QOS : fast::VOLATILE_DURABILITY_QOS;
    qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = per_second > 0 ? 100 : 1;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    const std::string hash = "typehash=RIHS01_" + std::string(64, name[0] == 's' ? '5' : '7') + ";";
    qos.user_data().setValue({hash.begin(), hash.end()});
    auto* const writer = require(publisher_->create_datawriter(topic, qos));
    const auto write = [writer] {
      Message message;
      fill(message);
      if (!writer->write(&message)) std::exit(1);
    };
    writers_.push_back({name, writer, write,
                        std::chrono::nanoseconds(per_second > 0 ? 1'000'000'000 / per_second : 0)});
  }

  void run(std::chrono::seconds time, int readers) {
    for (const Writer& each : writers_) {
      fast::PublicationMatchedStatus matched;
      while (each.writer->get_publication_matched_status(matched) != ReturnCode_t::RETCODE_OK ||
             matched.current_count < readers) {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      }
    }
    std::puts("ready");
    const auto end = Clock::now() + time;
    for (Writer& each : writers_) each.due = Clock::now();
    for (;;) {
      Writer* next = &writers_.front();
      for (Writer& each : writers_) {
        if (each.due < next->due) next = &each;
      }
      if (next->due > end) break;
      std::this_thread::sleep_until(next->due);
      next->write();
      ++next->written;
      next->due = next->period.count() > 0 ? next->due + next->period : Clock::time_point::max();
    }
    for (const Writer& each : writers_) std::printf("%s %d\n", each.name.c_str(), each.written);
    std::puts("done");
    std::fflush(stdout);
  }

 private:
  fast::DomainParticipant* const participant_ =
      require(fast::DomainParticipantFactory::get_instance()->create_participant(
          0, fast::PARTICIPANT_QOS_DEFAULT));
  fast::Publisher* const publisher_ =
      require(participant_->create_publisher(fast::PUBLISHER_QOS_DEFAULT));
  std::map<std::string, fast::Topic*> topics_;
  std::vector<Writer> writers_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  for (int i = 3; i < argc; ++i) {
    std::ifstream in(argv[i], std::ios::binary);
    images.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  Writers writers;
  for (int i = 0; i < 2; ++i) {
    writers.add<TFMessage_, tf2_msgs::msg::dds_::TFMessage_PubSubType>("tf_static", 0, true);
    writers.add<TFMessage_, tf2_msgs::msg::dds_::TFMessage_PubSubType>("tf", 30, true);
  }
  writers.add<Odometry_, nav_msgs::msg::dds_::Odometry_PubSubType>("odom", 30, true);
  writers.add<LaserScan_, sensor_msgs::msg::dds_::LaserScan_PubSubType>("scan", 5, false);
  writers.add<Imu_, sensor_msgs::msg::dds_::Imu_PubSubType>("imu", 20, true);
  writers.add<CompressedImage_, sensor_msgs::msg::dds_::CompressedImage_PubSubType>(
      "camera", 25, true, "image_raw/compressed");
  writers.run(std::chrono::seconds(std::atoi(argv[1])), std::atoi(argv[2]));
  for (;;) ::pause();
}
