// SPDX-License-Identifier: Apache-2.0
#include "server/sink/dds/dds_sink.hpp"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/use_future.hpp>
#include <chrono>
#include <cstddef>
#include <deque>
#include <exception>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "common/dds/dds_camera.hpp"
#include "common/dds/dds_node.hpp"
#include "common/log.hpp"
#include "common/ros_name.hpp"
#include "common/sample.hpp"
#include "server/session/session_reader.hpp"
#include "server/sink/dds/reader_losses.hpp"
#include "server/sink/paced_sink.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;

constexpr std::chrono::seconds kLastSecond{1};
constexpr std::chrono::seconds kBacklog{10};
/// Topics that begin within this time.
constexpr std::chrono::seconds kTogether{1};
constexpr std::size_t kMostLatched = 256;  // messages of a publisher, whatever the robot says
constexpr std::size_t kMostLatchedBytes = std::size_t{16} << 20;
/// A node that works for 30 ms at each frame needs no more between two.
constexpr std::chrono::milliseconds kBetweenFrames{34};
/// A frame that came so late delays no other.
constexpr std::chrono::milliseconds kAhead{20};

/// Of the images that are decoded for readers of raw ones, of different sessions.
constexpr unsigned kThreads = 4;

/// What all sinks share.
struct Dds {
  ~Dds() {
    threads.pool.join();
    node.reset();  // before the pool, which it uses
  }

  /// Of readers and for them, as long as something is published.
  void look() {
    asio::post(strand, [this] {
      if (!look_limit.lets_through()) return;
      reader_losses.look(participant.entity());
      tell();
    });
  }
  /// On `strand`.
  void tell() {
    if (const auto error = node->tell()) log_warn("dds: as a node: {}", error->text);
  }

  const DdsParticipant participant;
  const Pace::Clock::time_point begin = Pace::Clock::now() + DdsTopics::kDiscovery;
  ReaderLosses reader_losses;  // this and the next two: on `strand`
  LogLimit look_limit{std::chrono::seconds{1}};
  std::optional<DdsNode> node;
  PacedThreads threads{"dds", kThreads};
  const PoolStrand strand = asio::make_strand(threads.pool);
};

std::unique_ptr<Dds>& the_dds() {
  static std::unique_ptr<Dds> dds;
  return dds;
}

class DdsSession final : public PacedSession {
 public:
  DdsSession(const SessionInfo& info, const DdsSettings& settings)
      : PacedSession(the_dds()->threads, info, "dds", Pace(settings.pace, kBetweenFrames, kAhead),
                     kBacklog),
        name_(ros_name(info.robot_id)),
        frame_id_(ros_frame_id(settings.frame_id, name_)),
        cameras_(the_dds()->participant, name_, frame_id_, info.calibration, session_),
        topics_(the_dds()->participant, name_) {
    if (name_ != info.robot_id) {
      log_info("{}: ROS 2 allows letters, digits and _ in a topic's name: publishing on /{}",
               info.robot_id, name_);
    }
  }

  void open(const DdsBefore& before) {
    publish_latched(before);
    for (const wire::StreamDeclaration& stream : streams_) {
      if (stream.codec == wire::kSampleCodec) open(stream);
    }
    cameras_.open();
    asio::post(the_dds()->strand, [] { the_dds()->tell(); });
  }

 private:
  std::optional<Clock::time_point> wait_for_readers() override {
    return Clock::now() < begin_ ? std::optional(begin_) : std::nullopt;
  }
  /// Of the first topics of a session also the frames wait, so that they come in order.
  Clock::time_point begin_of(const TopicMessage& message) override {
    const auto begin = topics_.begin_of(message);
    if (!last_first_) last_first_ = begin + kTogether;
    if (begin <= *last_first_) begin_ = std::max(begin_, begin);
    return begin;
  }

  std::optional<Error> publish(const EncodedFrame& frame) override {
    the_dds()->look();
    return cameras_.publish(frame);
  }
  std::optional<Error> publish(const wire::StreamDeclaration& stream,
                               const Sample& sample) override {
    return sample.message ? topics_.publish(*sample.message) : open(stream).publish(sample);
  }

  DdsImu& open(const wire::StreamDeclaration& stream) {
    auto& imu = imus_[stream.id];
    if (!imu) {
      imu = std::make_unique<DdsImu>(the_dds()->participant, name_ + "/" + ros_name(stream.name),
                                     frame_id_);
    }
    return *imu;
  }

  /// As many of each publisher as it keeps, within bounds.
  void publish_latched(const DdsBefore& before) {
    const auto is_read = [&](const wire::StreamDeclaration& stream) {
      return stream.codec == wire::kTopicCodec && before.position[stream.id] > 0;
    };
    if (before.folder.empty() || std::ranges::none_of(streams_, is_read)) return;
    std::map<std::pair<std::size_t, std::uint64_t>, std::deque<Sample>> kept;
    std::size_t bytes = 0;
    const auto error = read_items(before.folder, [&](const RecordedItems& items) {
      const auto stream = std::ranges::find(streams_, items.stream, &wire::StreamDeclaration::id);
      if (stream == streams_.end() || !is_read(*stream)) return;
      if (items.is_late || items.next > before.position[stream->id]) return;
      const auto samples = wire::parse_samples(stream->codec, items.payload);
      if (!samples) return;
      const auto index = static_cast<std::size_t>(stream - streams_.begin());
      for (const Sample& sample : samples.value()) {
        if (!sample.message || !sample.message->publisher->is_latched) continue;
        auto& messages = kept[{index, sample.message->publisher->key}];
        bytes += sample.message->cdr.size();
        messages.push_back(sample);
        const auto depth = std::min<std::size_t>(sample.message->publisher->depth, kMostLatched);
        // The last one of a publisher stays, unless there are very many of these.
        while (messages.size() > depth || (bytes > kMostLatchedBytes && messages.size() > 1) ||
               (bytes > 4 * kMostLatchedBytes && !messages.empty())) {
          bytes -= messages.front().message->cdr.size();
          messages.pop_front();
        }
      }
    });
    if (error) log_warn("{}: topics are not published again: {}", session_, error->text);
    for (const auto& [key, messages] : kept) {
      for (const Sample& message : messages) add(key.first, 0, message);
    }
    publish_due();
  }

  const std::string name_;
  const std::string frame_id_;
  DdsCameras cameras_;
  Clock::time_point begin_ = the_dds()->begin;
  std::optional<Clock::time_point> last_first_;
  std::map<wire::StreamId, std::unique_ptr<DdsImu>> imus_;
  DdsTopics topics_;
};

}  // namespace

void begin_dds() {
  the_dds() = std::make_unique<Dds>();
  Dds& dds = *the_dds();
  // On the strand, so that tell() runs after it: a reader that is already there asks for it at
  // once.
  const auto tell = [&dds] { asio::post(dds.strand, [&dds] { dds.tell(); }); };
  const auto make = [&] { dds.node.emplace(dds.participant, "orbbuf_server", tell); };
  asio::post(dds.strand, asio::use_future(make)).get();
}

std::shared_ptr<FrameSink> make_dds_sink(asio::io_context& main, const SessionInfo& info,
                                         const DdsSettings& settings, const DdsBefore& before) {
  auto session = std::make_shared<DdsSession>(info, settings);
  asio::post(session->strand, [session, before] {
    try {
      session->open(before);
    } catch (const std::exception&) {  // the first frame tries again, and says why
    }
  });
  return std::make_shared<PacedSink>(main, the_dds()->threads, std::move(session));
}

void end_dds() {
  if (!the_dds()) return;
  PacedThreads& threads = the_dds()->threads;
  threads.finish(Pace::Clock::now() + kLastSecond);
  threads.pool.join();  // its work asks for the_dds()
  the_dds().reset();
}

}  // namespace orbbuf
