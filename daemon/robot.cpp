// SPDX-License-Identifier: Apache-2.0
#include "daemon/robot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/calibration/calibration.hpp"
#include "common/log.hpp"
#include "common/seconds.hpp"
#include "common/service_status.hpp"
#include "common/watched_thread.hpp"
#include "daemon/capture/make_source.hpp"
#include "daemon/clock_watch.hpp"
#include "daemon/net/sender.hpp"
#include "daemon/pipeline.hpp"
#include "daemon/reducer.hpp"
#ifdef ORBBUF_DAEMON_DDS
#include "daemon/topics/camera_publisher.hpp"
#endif

namespace orbbuf {
namespace asio = boost::asio;

namespace {

using std::chrono::nanoseconds;

constexpr std::chrono::seconds kTellInterval{1};

std::string describe(const ServerLink& link) {
  if (link.is_connected() && !link.pause().empty()) {
    return fmt::format("connected to {}, which takes nothing: {}", to_string(link.server()),
                       link.pause());
  }
  if (link.is_stalled()) return "stalled";
  if (link.is_connected()) return "connected to " + to_string(link.server());
  if (link.last_error().empty()) return "connecting";
  return "no connection: " + link.last_error();
}

/// Reports the daemon's state to the service manager. It is ready once a frame has been captured
/// and the first attempt to connect has ended, with or without success. It feeds the watchdog while
/// every watched thread has called beat() within the last half of the watchdog's period. A missing
/// camera or server does not stop the feeding. Thread-bound to `main`.
class Health {
 public:
  using Clock = std::chrono::steady_clock;

  /// `service` must outlive it.
  explicit Health(ServiceStatus& service) : service_(service), watchdog_(service.watchdog()) {}

  void report(const wire::Report& report, const Sender& sender) {
    if (Clock::now() >= reported_time_ + kTellInterval) tell(report, sender);
    if (report.stats.captured > 0 && sender.link().has_tried()) service_.ready();
    if (watchdog_ > nanoseconds(0)) feed_if_moving();
  }

 private:
  void tell(const wire::Report& report, const Sender& sender) {
    const wire::Stats& stats = report.stats;
    const auto now = Clock::now();
    const double seconds = to_seconds(now - std::exchange(reported_time_, now));
    const wire::Stats before = std::exchange(reported_, stats);
    const auto rate = [seconds](std::uint64_t from, std::uint64_t to) {
      return static_cast<double>(to - std::min(from, to)) / seconds;
    };
    const auto spooled = sender.spooled();
    const auto samples = sender.samples().stats();
    service_.status(fmt::format(
        "{:.1f} frames/s captured, {:.1f} delivered; buffer {} of {}{}; link {}{}{}",
        rate(before.captured, stats.captured), rate(before.acknowledged, stats.acknowledged),
        stats.waiting, report.capacity, spooled ? fmt::format("; spool {}", *spooled) : "",
        describe(sender.link()), samples.empty() ? "" : "; ", samples));
  }

  void feed_if_moving() {
    const auto limit = std::max<nanoseconds>(watchdog_ / 2, 2 * kBeatInterval);
    const auto still = WatchedThread::find_still(limit);
    std::set<std::string> names;
    for (const auto& [name, time] : still) {
      names.insert(name);
      if (still_.contains(name)) continue;
      log_error(
          "thread {} has not responded for {:.1f} s; feeding the watchdog stops until it does",
          name, to_seconds(time));
    }
    still_ = std::move(names);
    if (still_.empty()) service_.feed();
  }

  ServiceStatus& service_;
  const nanoseconds watchdog_;   // 0: none
  std::set<std::string> still_;  // threads, and logged
  wire::Stats reported_;         // at reported_time_
  Clock::time_point reported_time_ = Clock::now();
};

/// Everything of one session, in the order it is built; taken down in the reverse.
class Robot {
 public:
  explicit Robot(const Settings& settings);
  int run();

 private:
  /// From any thread.
  std::function<void()> wake_sender() {
    return [this] { asio::post(io_, [this] { sender_.wake(); }); };
  }
  void await_signal();
  void say_stopping(int signal) const;
  void await_reload();
  void on_pushed();
  void on_clock_stepped(nanoseconds total);
  void on_source_ended(bool failed);
  void report();
  void log_stats() const;

  ServiceStatus service_;
  asio::io_context io_{1};
  asio::signal_set signals_{io_, SIGINT, SIGTERM};
  asio::signal_set reload_{io_, SIGHUP};  // which never ends the robot
  std::unique_ptr<FrameSource> source_;   // until pipeline_ has it
  OrbExtractor extractor_;
  FrameBuffer buffer_;
  SampleStreams samples_;
  const wire::Hello hello_;
  Record record_;
  Sender sender_;
  std::optional<Reducer> reducer_;  // nothing: all frames are sent as they are
  Pipeline pipeline_;
  asio::steady_timer report_timer_{io_};
  Health health_;
  ClockWatch clock_watch_;
  const std::chrono::nanoseconds drain_timeout_;
  const bool may_reduce_;
  const bool is_camera_;  // else the times are the source's
  bool has_frames_ = false;
  bool is_stopping_ = false;  // by a signal
  bool source_failed_ = false;
  bool is_complete_ = false;
  bool is_over_ = false;  // nothing is left to wait for
};

wire::Hello make_hello(const Settings& settings, const SampleStreams& samples) {
  wire::Hello hello;
  hello.robot_id = settings.robot_id;
  hello.session_id = new_session_id();
  hello.software = "orbbufd " ORBBUF_VERSION;
  hello.calibration = settings.calibration;
  hello.streams = samples.declarations();
  std::vector<std::string> names;
  for (const Address& server : settings.link.servers) names.push_back(to_string(server));
  log_info("robot {}, session {}, policy {}, server {}", hello.robot_id, hello.session_id,
           settings.buffer.policy, fmt::join(names, ", "));
  return hello;
}

std::unique_ptr<FrameSource> open_source(const SourceSettings& settings) {
  auto source = make_source(settings);
  log_info("source: {}", source->description());
  return source;
}

/// A source that waits for room is not chosen from: it loses no frame, however late it becomes. It
/// waits for `capacity`, since the bytes of its next frame are not known.
BufferSettings buffer_settings(const Settings& settings, const FrameSource& source) {
  BufferSettings buffer = settings.buffer;
  if (!source.is_live()) {
    buffer.policy = "drop-oldest";
    buffer.memory_bytes = std::numeric_limits<std::uint64_t>::max();
    buffer.is_waited_for = true;
  }
  return buffer;
}

/// Takes each frame for the robot's own nodes; nothing if they get none.
std::function<void(const FramePtr&)> publish_to_robot([[maybe_unused]] const Settings& settings) {
#ifdef ORBBUF_DAEMON_DDS
  if (!settings.publish.empty()) {
    auto to = std::make_shared<CameraPublisher>(settings.publish, settings.calibration);
    return [to](const FramePtr& frame) { to->publish(frame); };
  }
#endif
  return {};
}

/// Takes each frame that was encoded.
std::function<void(const FramePtr&)> on_encoded(const Settings& settings) {
  return [publish = publish_to_robot(settings), calibration = settings.calibration,
          is_first = true](const FramePtr& frame) mutable {
    if (std::exchange(is_first, false)) {
      const auto problem = size_problem(calibration, frame->width_px, frame->height_px);
      if (!problem.empty()) log_warn("camera.calibration: {}", problem);
    }
    if (publish) publish(frame);
  };
}

Robot::Robot(const Settings& settings)
    : source_(open_source(settings.source)),
      extractor_(settings.features),
      buffer_(make_buffer(buffer_settings(settings, *source_),
                          [this](const EncodedFrame& frame, FeatureSet& features) {
                            extractor_.extract(frame, features);
                          })),
      samples_(io_, settings.streams, wake_sender()),
      hello_(make_hello(settings, samples_)),
      record_(settings.record, hello_.robot_id, hello_.session_id, wake_sender()),
      sender_(io_, settings.link, hello_, buffer_, record_, samples_),
      pipeline_(
          std::move(source_), settings.jpeg, buffer_,
          {[this] { asio::post(io_, [this] { on_pushed(); }); },
           [this](bool failed) { asio::post(io_, [this, failed] { on_source_ended(failed); }); },
           on_encoded(settings),
           [this](std::int64_t total_ns) {
             asio::post(io_, [this, total_ns] { on_clock_stepped(nanoseconds(total_ns)); });
           }}),
      health_(service_),
      drain_timeout_(settings.link.drain_timeout),
      may_reduce_(buffer_.encode_quality() &&
                  settings.buffer.plan.least_quality < settings.buffer.plan.quality),
      is_camera_(settings.source.kind == "v4l2" || settings.source.kind == "libcamera") {}

int Robot::run() {
  // A reader of the log that has gone is no reason to end.
  for (const int ignored : {SIGPIPE, SIGUSR1, SIGUSR2}) std::signal(ignored, SIG_IGN);
  await_signal();
  await_reload();
  if (is_camera_) {
    samples_.set_clock([this](std::int64_t time_ns) {
      clock_watch_.look(read_system_clock());
      return clock_watch_.session_time(time_ns);
    });
  }
  sender_.start();
  if (may_reduce_) reducer_.emplace(buffer_, wake_sender());
  pipeline_.start();
  report();
  io_.run();
  if (!is_over_) sender_.abandon();  // a second signal
  log_stats();
  if (source_failed_) return EXIT_FAILURE;
  if (const auto lost = sender_.lost(); lost > 0) {
    log_error("{} frames are lost, neither delivered nor kept: exit status {}; {}", lost,
              kFramesLost,
              record_.keeps_frames() ? "the disk of spool.path did not take them in time"
                                     : "spool.path would keep such frames");
    return kFramesLost;
  }
  return is_complete_ || is_stopping_ ? EXIT_SUCCESS : EXIT_FAILURE;
}

void Robot::await_signal() {
  signals_.async_wait([this](const boost::system::error_code& error, int signal) {
    if (error) return;
    if (std::exchange(is_stopping_, true)) return io_.stop();
    say_stopping(signal);
    service_.stopping();
    pipeline_.stop();
    await_signal();
  });
}

void Robot::say_stopping(int signal) const {
  const wire::Stats stats = buffer_.stats();
  const auto left = stats.waiting + stats.in_flight;
  if (left == 0) return log_info("signal {}: stopping", signal);
  log_info("signal {}: stopping; delivering {} frames, for at most {} s; a second signal ends {}",
           signal, left, to_seconds(drain_timeout_),
           record_.keeps_frames() ? "it at once and leaves them in the spool"
                                  : "it at once and loses them");
}

void Robot::await_reload() {
  reload_.async_wait([this](const boost::system::error_code& error, int /*signal*/) {
    if (error) return;
    sender_.reload_tls();
    await_reload();
  });
}

void Robot::on_pushed() {
  if (is_camera_ && !std::exchange(has_frames_, true)) {  // whose times begin here
    clock_watch_.look(read_system_clock());
    clock_watch_.begin_session();
  }
  sender_.on_pushed();
}

/// The messages that belong to frames have the stamps of their publisher's clock.
void Robot::on_clock_stepped(nanoseconds total) {
  samples_.set_frames_step(total.count());
  sender_.set_clock_offset(total);
}

void Robot::on_source_ended(bool failed) {
  source_failed_ = failed;
  service_.stopping();
  samples_.stop();
  sender_.finish([this](bool complete) {
    is_complete_ = complete;
    is_over_ = true;
    signals_.cancel();
    reload_.cancel();
    report_timer_.cancel();
  });
}

void Robot::report() {
  if (is_over_) return;
  if (is_camera_) {
    clock_watch_.look(read_system_clock());
    sender_.set_clock_offset(clock_watch_.stepped());
  }
  health_.report(buffer_.report(), sender_);
  report_timer_.expires_after(service_.interval());
  report_timer_.async_wait([this](const boost::system::error_code& /*error*/) { report(); });
}

void Robot::log_stats() const {
  const wire::Stats stats = buffer_.stats();
  log_info(
      "session ended: captured {} = skipped {} + failed {} + dropped {} + acknowledged {} + "
      "waiting {} + in flight {}",
      stats.captured, stats.skipped, stats.failed, stats.dropped, stats.acknowledged, stats.waiting,
      stats.in_flight);
  if (const auto samples = samples_.stats(); !samples.empty()) {
    log_info("samples: {}", samples);
  }
}

}  // namespace

int run_robot(const Settings& settings) { return Robot(settings).run(); }

}  // namespace orbbuf
