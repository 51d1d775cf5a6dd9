// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "common/drop_record.hpp"
#include "common/event_rate.hpp"
#include "common/frame.hpp"
#include "common/sample.hpp"
#include "common/wire.hpp"
#include "server/session/session_info.hpp"

namespace orbbuf {

/// What became of the frames that were captured in one second.
struct TimelineSecond {
  std::int64_t second = 0;  ///< by the robot's clock
  std::uint32_t delivered = 0;
  std::uint32_t dropped = 0;
  std::uint16_t similarity = kUnknownSimilarity;  ///< the smallest of the dropped
  std::uint32_t delay_ms = 0;  ///< the longest on the way; 0 is that of the session's fastest frame
  std::chrono::steady_clock::time_point changed{};
};

/// A time without a frame of a robot that had something to send.
struct Outage {
  std::chrono::nanoseconds begin{};  ///< by the robot's clock
  std::chrono::nanoseconds end{};
};

/// The last two minutes of a session, by the time of capture. Of the robot's clock it is known only
/// what the frames say: that of the frame that was fastest, lately, is taken for ours.
/// Memory: some 8 KB, whatever times the robot claims. Reentrant.
class Timeline {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::int64_t kSeconds = 120;
  static constexpr std::size_t kOutages = 32;

  /// Anything came; `is_new` on a new connection.
  void on_heard(Time now, bool is_new);
  /// Frames in the order in which they came; after on_heard().
  void on_delivered(std::int64_t capture_time_ns, Time now);
  void on_dropped(const DropRecord& record, Time now);

  /// Oldest first; seconds of which nothing is known are missing.
  const std::deque<TimelineSecond>& seconds() const { return seconds_; }
  const std::deque<Outage>& outages() const { return outages_; }
  Time last_heard() const { return heard_; }
  /// The robot's clock, at our `time`; 0 if no frame has come.
  std::chrono::nanoseconds robot_time(Time time) const;
  /// Since the frame that was delivered last was captured. Nothing if none was.
  std::optional<std::chrono::nanoseconds> age(Time now) const;

 private:
  using Nanoseconds = std::chrono::nanoseconds;

  TimelineSecond* second_of(std::int64_t capture_time_ns, bool is_in_order);
  Nanoseconds note_offset(Nanoseconds offset, Time now);

  std::deque<TimelineSecond> seconds_;
  std::deque<Outage> outages_;
  std::optional<Nanoseconds> newest_;  // capture time
  Time heard_{};
  Time silent_since_{};  // the last but one time, if it was long before
  bool is_silence_over_ = false;
  bool is_after_connect_ = false;
  // Our clock less the robot's, at the least: of this minute with frames, and of the one before.
  static constexpr Nanoseconds kNone{std::numeric_limits<Nanoseconds::rep>::max()};
  Nanoseconds offset_ = kNone;
  Nanoseconds offset_before_ = kNone;
  Time minute_{};
};

class RobotMetrics;

/// The samples that were captured in one second.
struct SampleSecond {
  std::int64_t second = 0;  ///< by the robot's clock
  std::uint32_t samples = 0;
  std::uint32_t lost = 0;            ///< numbers left out before one of them
  std::uint32_t longest_gap_ms = 0;  ///< before one of them
  double fastest_turn = 0;           ///< degrees per second
  std::chrono::steady_clock::time_point changed{};
};

/// What came of a stream of samples, since this session began on this server.
struct StreamMetrics {
  std::uint64_t captured = 0;  ///< as the robot reports: of the whole session
  std::uint64_t next = 0;      ///< behind the newest one here
  std::uint64_t samples = 0;
  std::uint64_t lost = 0;  ///< numbers that the robot left out; some may come late
  EventRate rate{};
  EventRate::Time newest{};            ///< when it came, if `samples` > 0
  std::int64_t newest_time_ns = 0;     ///< by the robot's clock
  std::deque<SampleSecond> seconds{};  ///< the last Timeline::kSeconds, the oldest first

  /// On the robot, to be sent; of a report that is older than the samples, none.
  std::uint64_t waiting() const { return captured - std::min(captured, next); }
  std::optional<std::chrono::nanoseconds> age(EventRate::Time now) const;
};

/// Is told what the metrics are, as it happens. All calls are on `main`.
class MetricsWatcher {
 public:
  virtual ~MetricsWatcher() = default;
  /// A session begins.
  virtual void on_begun(const RobotMetrics& robot) = 0;
  virtual void on_frame(const RobotMetrics& robot, const EncodedFrame& frame) = 0;
  virtual void on_drops(const RobotMetrics& robot, std::span<const DropRecord> records) = 0;
  /// It has reported, connected, disconnected or ended.
  virtual void on_state(const RobotMetrics& robot) = 0;
};

/// What is known of a robot's latest session, for people and their tools: nothing in the server
/// depends on it. The session tells; the page, /metrics and `status` read. Holds one frame, the
/// newest, if a page can show it. Thread-bound to `main`.
class RobotMetrics {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = Clock::time_point;

  explicit RobotMetrics(SessionInfo info, bool keeps_frame = true,
                        std::weak_ptr<MetricsWatcher> watcher = {})
      : info_(std::move(info)), keeps_frame_(keeps_frame), watcher_(std::move(watcher)) {}

  void on_connected(Time now = Clock::now());
  void on_disconnected();
  void on_report(const wire::Report& report, Time now = Clock::now());
  /// The sinks have taken it.
  void on_delivered(FramePtr frame, Time now = Clock::now());
  void on_dropped(std::span<const DropRecord> records, Time now = Clock::now());
  /// Samples of the stream `name`, from the number `first` on; those from `expected` to it never
  /// came.
  void on_samples(const std::string& name, std::uint64_t expected, std::uint64_t first,
                  std::span<const Sample> samples, Time now = Clock::now());
  /// Of those that the sinks have taken: given up since, for the readers of one of them.
  void on_lost(std::uint64_t total) { lost_ = total; }
  /// A frame that its session's live stream had passed over has arrived, of this session or an
  /// earlier one.
  void on_late(bool is_present_session);
  /// The robot has said how many such frames it keeps: of this session, and of all of them.
  void on_spool(std::uint64_t held_present, std::uint64_t held_all) {
    on_robot_ = {held_present, held_all};
  }
  /// What is of the robot and not of its session goes on.
  void follow(const RobotMetrics& before);
  /// A sink fails: nothing more is taken from the robot until on_resumed().
  void on_paused(std::string why) { pause_ = std::move(why); }
  void on_resumed() { pause_.clear(); }
  void on_ended(Time now = Clock::now());

  const SessionInfo& info() const { return info_; }
  bool is_connected() const { return is_connected_; }
  bool is_ended() const { return ended_.has_value(); }
  /// One word: `connected`, `disconnected` or `ended`.
  std::string state() const;
  /// Why its stream is paused; empty: it is not.
  const std::string& pause() const { return pause_; }
  std::optional<Time> ended_at() const { return ended_; }
  std::uint64_t connections() const { return connections_; }

  /// Since this session began on this server.
  std::uint64_t frames() const { return frames_; }
  std::uint64_t bytes() const { return bytes_; }
  /// Of the frames, those with a reduced JPEG.
  std::uint64_t reduced() const { return reduced_; }
  /// Of the newest frame's JPEG; 0: not known.
  std::uint8_t quality() const { return quality_; }
  std::uint64_t drops() const { return drops_; }
  std::uint64_t lost() const { return lost_; }
  /// Frames of this session that arrived late; of all sessions, since this server was started.
  std::uint64_t late() const { return late_; }
  std::uint64_t late_total() const { return late_total_; }
  /// Frames that the robot keeps, to send them late; nothing if it has not said so.
  struct OnRobot {
    std::uint64_t present = 0;  ///< of this session
    std::uint64_t all = 0;      ///< of all its sessions

    friend bool operator==(const OnRobot&, const OnRobot&) = default;
  };
  const std::optional<OnRobot>& on_robot() const { return on_robot_; }
  /// By name, once the robot has reported.
  const std::map<std::string, StreamMetrics>& streams() const { return streams_; }
  /// Frames a second, of the last second or two.
  double frame_rate(Time now) const { return ended_ ? 0 : rate_.per_second(now); }

  /// The robot's own word, and when it came.
  const std::optional<wire::Report>& report() const { return report_; }
  Time report_time() const { return report_time_; }

  const FramePtr& newest() const { return newest_; }  ///< null if there is none
  const Timeline& timeline() const { return timeline_; }

 private:
  void tell_state() const;
  static void note(StreamMetrics& stream, const Sample& sample, std::uint64_t lost, Time now);

  const SessionInfo info_;
  const bool keeps_frame_;
  const std::weak_ptr<MetricsWatcher> watcher_;
  bool is_connected_ = false;
  std::string pause_;
  std::optional<Time> ended_;
  std::uint64_t connections_ = 0;
  std::uint64_t frames_ = 0;
  std::uint64_t bytes_ = 0;
  std::uint64_t reduced_ = 0;
  std::uint8_t quality_ = 0;
  std::uint64_t drops_ = 0;
  std::uint64_t lost_ = 0;
  std::uint64_t late_ = 0;
  std::uint64_t late_total_ = 0;
  std::optional<OnRobot> on_robot_;
  std::optional<wire::Report> report_;
  Time report_time_{};
  FramePtr newest_;
  Timeline timeline_;
  EventRate rate_;
  std::map<std::string, StreamMetrics> streams_;
};

/// Programs that show what the robots send (FoxgloveServer).
struct ViewerCounts {
  std::uint64_t open = 0;
  std::uint64_t given_up = 0;  ///< messages, in all, that they were too slow for
};

/// All robots that have been here since the server was started; of those that are gone, the last.
/// Thread-bound to `main`.
class Metrics {
 public:
  using Robots = std::map<std::string, std::shared_ptr<RobotMetrics>>;

  explicit Metrics(std::size_t max_robots, bool keep_frames = true)
      : max_robots_(max_robots), keep_frames_(keep_frames) {}

  /// Of the sessions that begin from now on.
  void watch(std::weak_ptr<MetricsWatcher> watcher) { watcher_ = std::move(watcher); }

  /// A session begins: its metrics take the place of the robot's earlier ones.
  std::shared_ptr<RobotMetrics> begin(const SessionInfo& info);

  const Robots& robots() const { return robots_; }

  ViewerCounts& viewers() { return viewers_; }
  const ViewerCounts& viewers() const { return viewers_; }

 private:
  const std::size_t max_robots_;
  const bool keep_frames_;
  std::weak_ptr<MetricsWatcher> watcher_;
  ViewerCounts viewers_;
  Robots robots_;
};

/// The metrics for a terminal: a heading, and a line for each robot; likewise for each stream of
/// samples, if there is one; and why a robot's stream is paused.
std::string to_table(const Metrics& metrics, RobotMetrics::Time now);

}  // namespace orbbuf
