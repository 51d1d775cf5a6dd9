// SPDX-License-Identifier: Apache-2.0
#include "server/sink/dds/dds_sink.hpp"

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstddef>
#include <deque>
#include <exception>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "common/jpeg.hpp"
#include "common/log.hpp"
#include "common/sample.hpp"
#include "server/calibration/camera_info.hpp"
#include "server/session/session_reader.hpp"
#include "server/sink/dds/dds_camera.hpp"
#include "server/sink/losses.hpp"
#include "server/sink/ros_name.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kMostQueuedBytes = std::size_t{64} << 20U;
constexpr std::chrono::seconds kLastSecond{1};

/// What all sinks share.
struct Dds {
  Dds() {
    asio::post(thread, [] { name_this_thread("dds"); });
  }
  bool is_over() const { return Clock::now() > end.load(); }

  const DdsParticipant participant;
  const Clock::time_point begin = Clock::now() + DdsTopics::kDiscovery;
  std::atomic<Clock::time_point> end{Clock::time_point::max()};
  std::atomic<std::size_t> waiting_bytes{0};  // of the frames that `dds` has not come to
  JpegCodec codec;                            // `dds` only
  asio::thread_pool thread{1};                // last: its work uses the others
};

std::unique_ptr<Dds>& the_dds() {
  static std::unique_ptr<Dds> dds;
  return dds;
}

/// A session's topics. On `dds` only, but for `losses`.
class Topics : public std::enable_shared_from_this<Topics> {
 public:
  Topics(const SessionInfo& info, std::string_view frame_id)
      : losses(fmt::format("{} {}: dds", info.robot_id, info.session_id)),
        session_(info.robot_id + " " + info.session_id),
        name_(ros_name(info.robot_id)),
        frame_id_(ros_frame_id(frame_id, name_)),
        cameras_(calibrated_cameras(info.calibration, session_ + ": published")),
        streams_(info.streams),
        topics_(the_dds()->participant, name_) {
    if (name_ != info.robot_id) {
      log_info("{}: ROS 2 allows letters, digits and _ in a topic's name: publishing on /{}",
               info.robot_id, name_);
    }
  }

  void open(bool is_stereo) {
    if (left_ && is_stereo == (right_ != nullptr)) return;
    const DdsParticipant& participant = the_dds()->participant;
    right_.reset();
    left_.reset();
    left_ =
        std::make_unique<DdsCamera>(participant, is_stereo ? name_ + "/left" : name_, frame_id_);
    if (is_stereo) right_ = std::make_unique<DdsCamera>(participant, name_ + "/right", frame_id_);
    if (is_stereo) warn_without_right_camera(cameras_, session_);
  }
  void open(const DdsBefore& before) {
    publish_latched(before);
    for (const wire::StreamDeclaration& stream : streams_) {
      if (stream.codec == wire::kSampleCodec) open(stream);
    }
    open(cameras_.right.has_value());
  }

  std::optional<Error> publish(const EncodedFrame& frame) {
    open(frame.is_stereo());
    const auto time_ns = frame.capture_time_ns;
    auto error = publish(*left_, time_ns, frame.left(), cameras_.left);
    if (!error && right_) error = publish(*right_, time_ns, frame.right(), cameras_.right);
    return error;
  }

  std::optional<Error> publish(const wire::Items& items) {
    const auto stream = std::ranges::find(streams_, items.stream, &wire::StreamDeclaration::id);
    const auto samples = wire::parse_samples(items.payload);
    if (stream == streams_.end() || !samples) return std::nullopt;
    std::optional<Error> failed;
    for (const Sample& sample : samples.value()) {
      auto error = sample.message ? topics_.publish(sample.message) : open(*stream).publish(sample);
      if (error) failed = std::move(error);
    }
    if (const auto due = topics_.due()) publish_at(*due);
    return failed;
  }

  Losses losses;

 private:
  DdsImu& open(const wire::StreamDeclaration& stream) {
    auto& imu = imus_[stream.id];
    if (!imu) {
      imu = std::make_unique<DdsImu>(the_dds()->participant, name_ + "/" + ros_name(stream.name),
                                     frame_id_);
    }
    return *imu;
  }

  /// As many of each publisher as it keeps.
  void publish_latched(const DdsBefore& before) {
    for (const wire::StreamDeclaration& stream : streams_) {
      const std::uint64_t end = before.position[stream.id];
      if (stream.codec != wire::kTopicCodec || end == 0 || before.folder.empty()) continue;
      std::map<std::uint64_t, std::deque<std::shared_ptr<const TopicMessage>>> kept;
      const auto error = read_items(before.folder, stream.id, [&](const RecordedItems& items) {
        const auto samples = wire::parse_samples(items.payload);
        if (items.is_late || items.next > end || !samples) return;
        for (const Sample& sample : samples.value()) {
          if (!sample.message || !sample.message->publisher->is_latched) continue;
          auto& messages = kept[sample.message->publisher->key];
          messages.push_back(sample.message);
          if (messages.size() > sample.message->publisher->depth) messages.pop_front();
        }
      });
      if (error) log_warn("{}: {} is not published again: {}", session_, stream.name, error->text);
      for (const auto& [key, messages] : kept) {
        for (const auto& message : messages) topics_.publish(message);
      }
    }
    if (const auto due = topics_.due()) publish_at(*due);
  }

  /// What waits for readers of its topic.
  void publish_at(Clock::time_point due) {
    timer_.expires_at(due);
    timer_.async_wait([weak = weak_from_this()](const boost::system::error_code& cancelled) {
      const auto self = weak.lock();
      if (!self || cancelled) return;
      if (const auto error = self->topics_.publish_due(Clock::now())) self->losses.add(error->text);
      if (const auto next = self->topics_.due()) self->publish_at(*next);
    });
  }

  static std::optional<Error> publish(DdsCamera& camera, std::int64_t time_ns,
                                      std::span<const std::uint8_t> jpeg,
                                      const std::optional<CameraInfo>& info) {
    if (auto error = camera.publish(time_ns, jpeg, info ? &*info : nullptr)) return error;
    if (!camera.has_raw_reader()) return std::nullopt;
    const auto image = the_dds()->codec.decode_gray(jpeg, 1);
    if (!image) return image.error();
    return camera.publish_raw(time_ns, image.value());
  }

  const std::string session_;
  const std::string name_;
  const std::string frame_id_;
  const CalibratedCameras cameras_;
  const std::vector<wire::StreamDeclaration> streams_;
  std::map<wire::StreamId, std::unique_ptr<DdsImu>> imus_;
  DdsTopics topics_;
  asio::steady_timer timer_{the_dds()->thread};
  std::unique_ptr<DdsCamera> left_;   // or the only one
  std::unique_ptr<DdsCamera> right_;  // null: not stereo
};

/// On `dds`. DDS's errors are reasons of losses, whatever they are.
template <class Message>
void publish(Topics& topics, const Message& message) {
  std::this_thread::sleep_until(the_dds()->begin);
  if (the_dds()->is_over()) return topics.losses.add("the server stops");
  try {
    if (const auto error = topics.publish(message)) topics.losses.add(error->text);
  } catch (const std::exception& error) {
    topics.losses.add(error.what());
  }
}

class DdsSink final : public FrameSink {
 public:
  DdsSink(asio::io_context& main, const SessionInfo& info, std::string_view frame_id,
          const DdsBefore& before)
      : main_(main), topics_(std::make_shared<Topics>(info, frame_id)) {
    asio::post(the_dds()->thread, [topics = topics_, before] {
      try {
        topics->open(before);
      } catch (const std::exception&) {  // the first frame tries again, and says why
      }
    });
  }
  ~DdsSink() override {
    asio::post(the_dds()->thread, [topics = std::move(topics_)] {});  // they end there
  }
  DdsSink(const DdsSink&) = delete;
  DdsSink& operator=(const DdsSink&) = delete;

  void async_write(FramePtr frame, Done done) override {
    const std::size_t bytes = frame->jpeg.size();
    publish_later(std::move(frame), bytes);
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

  bool takes_items() const override { return true; }
  void async_write_items(ItemsPtr items, Done done) override {
    const std::size_t bytes = items->payload.size();
    if (items->stream >= wire::kFirstOther) publish_later(std::move(items), bytes);
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

  std::uint64_t lost() const override { return topics_->losses.count(); }

 private:
  template <class Message>
  void publish_later(Message message, std::size_t bytes) {
    Dds& dds = *the_dds();
    if (dds.waiting_bytes + bytes > kMostQueuedBytes) {
      return topics_->losses.add("64 MiB of frames wait for DDS");
    }
    dds.waiting_bytes += bytes;
    asio::post(dds.thread, [&dds, bytes, topics = topics_, message = std::move(message)] {
      publish(*topics, *message);
      dds.waiting_bytes -= bytes;
    });
  }

  asio::io_context& main_;
  std::shared_ptr<Topics> topics_;  // shared with what waits on `dds`
};

}  // namespace

void begin_dds() { the_dds() = std::make_unique<Dds>(); }

std::shared_ptr<FrameSink> make_dds_sink(asio::io_context& main, const SessionInfo& info,
                                         std::string_view frame_id, const DdsBefore& before) {
  return std::make_shared<DdsSink>(main, info, frame_id, before);
}

void end_dds() {
  if (!the_dds()) return;
  the_dds()->end = Clock::now() + kLastSecond;
  the_dds()->thread.join();
  the_dds().reset();
}

}  // namespace orbbuf
