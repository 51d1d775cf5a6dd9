// SPDX-License-Identifier: Apache-2.0
// Many robots from one process into one real server that writes files: whether all is delivered,
// how soon it is on disk, and what the server takes for it. Then many robots that only say that
// they are there. Then one that comes back to a session of many frames, while another streams.
// Then some whose images a program reads decoded, and one without a program.
// Then one that many viewers look at.
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <future>
#include <memory>

#include "bench/load/robot.hpp"
#include "bench/load/viewers.hpp"
#include "bench/load/wake_cost.hpp"
#include "bench/run_program.hpp"
#include "bench/watched_process.hpp"
#include "common/address.hpp"
#include "common/as_bytes.hpp"
#include "common/command_line.hpp"
#include "server/session/session_store.hpp"
#include "testing/process.hpp"
#include "testing/robot_client.hpp"

namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using orbbuf::bench::WatchedProcess;
using orbbuf::load::Clock;
using orbbuf::load::Content;
using orbbuf::load::Robot;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Seconds = std::chrono::duration<double>;

constexpr std::chrono::seconds kPatience{60};
constexpr milliseconds kSampling{50};
constexpr std::size_t kResumedFrames = 300'000;
constexpr std::size_t kPipes = 30;
constexpr std::size_t kViewers = 64;
constexpr int kViewRounds = 4;

struct Options {
  std::string server;
  fs::path work;
  std::size_t robots = 64;
  double fps = 25;
  std::size_t bytes = 40'000;
  double seconds = 60;
  std::size_t idle_robots = 500;
  double idle_seconds = 20;
  std::uint64_t seed = 1;
  std::string sync = "ack";
  std::string only;
};

using Settings = std::vector<std::string>;

/// orbbuf-server with its files in a folder of the work folder, until end().
class Server {
 public:
  Server(const Options& options, const std::string& folder, std::size_t robots,
         const Settings& more = {})
      : files_(options.work / folder), process_(command(options, files_, robots, more)) {
    const std::string words = "listening on ";
    const auto address =
        orbbuf::parse_address(orbbuf::test::word_after(process_.require_line(words), words));
    endpoint_ = {asio::ip::make_address(address.value().host), address.value().port};
  }

  void end() {
    process_.signal(SIGTERM);
    if (process_.wait() != 0) throw std::runtime_error("server: " + process_.output());
  }
  asio::ip::tcp::endpoint endpoint() const { return endpoint_; }
  /// Requires http.address.
  std::uint16_t http_port() const {
    const std::string words = "live page on http://";
    return orbbuf::parse_address(orbbuf::test::word_after(process_.output(), words)).value().port;
  }
  WatchedProcess watched() const { return WatchedProcess(process_.pid()); }
  const fs::path& files() const { return files_; }

 private:
  static std::vector<std::string> command(const Options& options, const fs::path& files,
                                          std::size_t robots, const Settings& more) {
    const std::string count = std::to_string(robots);
    Settings settings = {
        "listen.address=127.0.0.1:0",
        // All say hello at once, and a quarter of the places is for who has not yet.
        "listen.max_connections=" + std::to_string(4 * robots),
        "listen.max_connections_per_address=" + count, "listen.max_robots=" + count,
        "files.path=" + files.string(), "files.sync=" + options.sync};
    settings.insert(settings.end(), more.begin(), more.end());
    return orbbuf::test::with_settings({options.server}, settings);
  }

  const fs::path files_;
  orbbuf::test::Process process_;
  asio::ip::tcp::endpoint endpoint_;
};

/// Robots that begin in turn, so that no two tick together.
class Fleet {
 public:
  Fleet(const Content& content, std::size_t count, std::uint64_t frames, nanoseconds interval)
      : interval_(interval) {
    for (std::size_t i = 0; i < count; ++i) {
      robots_.push_back(std::make_unique<Robot>(io_, content, Robot::Plan{i, frames, interval}));
    }
  }

  void connect(const asio::ip::tcp::endpoint& server) {
    await_all(kPatience, [&](Robot& robot, auto done) { robot.connect(server, done); });
  }
  void start(const std::function<void()>& settled) {
    const auto first = Clock::now() + milliseconds(100);
    const auto count = static_cast<nanoseconds::rep>(robots_.size());
    for (nanoseconds::rep i = 0; i < count; ++i) {
      robots_[static_cast<std::size_t>(i)]->start(first + i * interval_ / count, settled);
    }
  }
  /// All stream to the last ack, which is due `length` from now at the soonest.
  void stream(nanoseconds length, const std::function<void()>& sample) {
    std::size_t left = robots_.size();
    start([&left] { --left; });
    const auto limit = Clock::now() + length + kPatience;
    while (left > 0 && Clock::now() < limit) {
      io_.run_for(kSampling);
      sample();
    }
    if (left > 0) throw std::runtime_error(std::to_string(left) + " robots wait for acks in vain");
  }
  void run_for(nanoseconds time) { io_.run_for(time); }
  void end() {
    await_all(kPatience, [](Robot& robot, auto done) { robot.end(done); });
  }
  const std::vector<std::unique_ptr<Robot>>& robots() const { return robots_; }

 private:
  /// Something that each robot is to be done with.
  template <class Begin>
  void await_all(nanoseconds limit, Begin begin) {
    std::size_t left = robots_.size();
    for (const auto& robot : robots_) begin(*robot, [&left] { --left; });
    const auto end = Clock::now() + limit;
    while (left > 0 && io_.run_one_until(end) > 0) {
    }
    if (left > 0) throw std::runtime_error(std::to_string(left) + " robots have no answer");
  }

  const nanoseconds interval_;
  asio::io_context io_{1};
  std::vector<std::unique_ptr<Robot>> robots_;
};

void result(const char* name, double value) { std::printf("RESULT load.%s %.5g\n", name, value); }

double milliseconds_of(nanoseconds time) { return Seconds(time).count() * 1000; }

/// From capture; returns the 99th percentile in ms.
double report_latency(const char* until, std::vector<nanoseconds> all) {
  std::ranges::sort(all);
  const auto share = [&](double part) {
    return milliseconds_of(all[static_cast<std::size_t>(part * static_cast<double>(all.size()))]);
  };
  std::printf("  capture to %s: median %.1f ms, p99 %.1f ms, p99.9 %.1f ms, worst %.1f ms\n", until,
              share(0.5), share(0.99), share(0.999), milliseconds_of(all.back()));
  return share(0.99);
}

/// Of all robots but the last `without`.
std::vector<nanoseconds> gather(const Fleet& fleet,
                                const std::vector<nanoseconds>& (Robot::*latencies)() const,
                                std::size_t without = 0) {
  std::vector<nanoseconds> all;
  for (std::size_t i = 0; i + without < fleet.robots().size(); ++i) {
    const auto& of_robot = ((*fleet.robots()[i]).*latencies)();
    all.insert(all.end(), of_robot.begin(), of_robot.end());
  }
  return all;
}

void report_latencies(const Fleet& fleet) {
  const double received_ms = report_latency("received", gather(fleet, &Robot::received_latencies));
  const double ack_ms = report_latency("ack", gather(fleet, &Robot::latencies));
  nanoseconds late{};
  for (const auto& robot : fleet.robots()) late = std::max(late, robot->most_late());
  std::printf("  of which before the frame was made: at most %.1f ms\n", milliseconds_of(late));
  result("received_p99_ms", received_ms);
  result("p99_ms", ack_ms);
}

void report_delivered(const Fleet& fleet, const Content& content, const fs::path& files) {
  std::uint64_t captured = 0;
  std::uint64_t delivered = 0;
  for (std::size_t i = 0; i < fleet.robots().size(); ++i) {
    const Robot& robot = *fleet.robots()[i];
    captured += robot.captured();
    delivered += content.count_delivered(files / robot.id() / Robot::kSession, i, robot.captured());
  }
  std::printf("  captured %lu, byte for byte on disk %lu\n", captured, delivered);
  std::printf("RESULT load.delivered_share %.6f\n",
              static_cast<double>(delivered) / static_cast<double>(captured));
}

void stream(const Options& options) {
  const Content content(options.seed, options.bytes);
  const auto interval = std::chrono::duration_cast<nanoseconds>(Seconds(1 / options.fps));
  const auto length = std::chrono::duration_cast<nanoseconds>(Seconds(options.seconds));
  const auto frames = static_cast<std::uint64_t>(options.fps * options.seconds);
  Server server(options, "stream", options.robots);
  const WatchedProcess watched = server.watched();
  const auto empty_kib = watched.resident_kib();
  const auto idle_tcp_kib = orbbuf::bench::tcp_memory_kib();
  auto tcp_kib = idle_tcp_kib;

  Fleet fleet(content, options.robots, frames, interval);
  fleet.connect(server.endpoint());
  const nanoseconds waited_before = watched.waiting_time();
  const nanoseconds cpu_before = watched.cpu_time();
  const auto begin = Clock::now();
  fleet.stream(length, [&] { tcp_kib = std::max(tcp_kib, orbbuf::bench::tcp_memory_kib()); });
  const Seconds took = Clock::now() - begin;
  const Seconds cpu = watched.cpu_time() - cpu_before;
  const Seconds waited = watched.waiting_time() - waited_before;
  const auto peak_kib = watched.peak_kib();
  fleet.end();
  server.end();

  const auto robots = static_cast<double>(options.robots);
  std::printf("  server: resident %lu KiB without robots, at most %lu KiB\n", empty_kib, peak_kib);
  std::printf("  all TCP sockets of this machine, both ends: at most %lu KiB more than before\n",
              tcp_kib - idle_tcp_kib);
  report_latencies(fleet);
  std::printf("  server's threads ready to run, but others had the processors: %.2f s\n",
              waited.count());
  result("kib_per_robot", static_cast<double>(peak_kib - empty_kib) / robots);
  result("socket_kib_per_robot", static_cast<double>(tcp_kib - idle_tcp_kib) / robots);
  result("server_cores", cpu / took);
  report_delivered(fleet, content, server.files());
}

void idle(const Options& options) {
  const Content content(options.seed, 1);
  Server server(options, "idle", options.idle_robots);
  const WatchedProcess watched = server.watched();
  const auto empty_kib = watched.resident_kib();
  Fleet fleet(content, options.idle_robots, 0, std::chrono::seconds(1));
  fleet.connect(server.endpoint());
  fleet.start({});
  fleet.run_for(std::chrono::seconds(2));  // past the hellos
  const nanoseconds before = watched.cpu_time();
  const auto begin = Clock::now();
  fleet.run_for(std::chrono::duration_cast<nanoseconds>(Seconds(options.idle_seconds)));
  const Seconds took = Clock::now() - begin;
  const Seconds cpu = watched.cpu_time() - before;
  const Seconds wake = orbbuf::load::bare_wake_cost();
  std::printf("  a thread that is woken %zu times a second and does nothing takes %.2g of a core\n",
              options.idle_robots, wake.count() * static_cast<double>(options.idle_robots));
  result("idle_core_share", cpu / took);
  result("idle_kib_per_robot", static_cast<double>(watched.peak_kib() - empty_kib) /
                                   static_cast<double>(options.idle_robots));
  fleet.end();
  server.end();
}

/// A session as a server has left it, with images of one byte.
void make_session(const fs::path& folder, std::size_t frames) {
  const auto must = [&](const auto& done) {
    if (!done) throw std::runtime_error("cannot write to " + folder.string());
  };
  auto store = orbbuf::SessionStore::open(folder, {"back", Robot::kSession, "", {}},
                                          orbbuf::Durability::kOff);
  must(store);
  orbbuf::EncodedFrame frame;
  frame.jpeg = {'i'};
  frame.jpeg_crc = orbbuf::crc32(frame.jpeg);
  for (frame.sequence = 0; frame.sequence < frames; ++frame.sequence) {
    frame.capture_time_ns = static_cast<std::int64_t>(frame.sequence) * 40'000'000;
    must(!store.value()->write(frame, 0));
  }
  must(!store.value()->finish(false));
  ::sync();  // else the first commit of the server would bring all of it onto the disk
}

void resume(const Options& options) {
  const Content content(options.seed, options.bytes);
  const auto interval = std::chrono::duration_cast<nanoseconds>(Seconds(1 / options.fps));
  const auto length = std::chrono::seconds(2);
  make_session(options.work / "resume/back/load", kResumedFrames);
  Server server(options, "resume", 2);
  Fleet fleet(content, 1, static_cast<std::uint64_t>(2 * options.fps), interval);
  fleet.connect(server.endpoint());
  auto resumed = std::async(std::launch::async, [&] {
    const orbbuf::test::RobotClient robot(server.endpoint().port());
    const auto begin = Clock::now();
    const auto position = robot.hello("back", Robot::kSession);
    if (!position || (*position)[orbbuf::wire::kFrames] != kResumedFrames) {
      throw std::runtime_error("the session was not resumed");
    }
    return Seconds(Clock::now() - begin).count();
  });
  fleet.stream(length, [] {});
  const double took = resumed.get();
  const double p99_ms = report_latency("ack", gather(fleet, &Robot::latencies));
  std::printf("RESULT recover.resume_s.300k %.3f\nRESULT recover.other_ack_p99_ms %.1f\n", took,
              p99_ms);
  fleet.end();
  server.end();
}

void pipes(const Options& options) {
  const Content content(options.seed, options.bytes);
  const auto interval = std::chrono::duration_cast<nanoseconds>(Seconds(1 / options.fps));
  const auto length = std::chrono::duration_cast<nanoseconds>(Seconds(options.idle_seconds));
  const auto frames = static_cast<std::uint64_t>(options.fps * options.idle_seconds);
  Server server(options, "pipes", kPipes + 1,
                {"slam.command=exec cat >/dev/null",
                 "robot.robot-" + std::to_string(kPipes) + ".slam.command="});
  Fleet fleet(content, kPipes + 1, frames, interval);
  fleet.connect(server.endpoint());
  fleet.stream(length, [] {});
  std::printf("  with a program:\n");
  const double with_ms = report_latency("ack", gather(fleet, &Robot::latencies, 1));
  std::printf("  without:\n");
  const double without_ms = report_latency("ack", fleet.robots().back()->latencies());
  result("pipes_p99_ms.with", with_ms);
  result("pipes_p99_ms.without", without_ms);
  fleet.end();
  server.end();
}

/// In turns, so that whatever else this machine does is the same for both.
void viewers(const Options& options) {
  const Content content(options.seed, options.bytes);
  const auto interval = std::chrono::duration_cast<nanoseconds>(Seconds(1 / options.fps));
  const auto length = std::chrono::duration_cast<nanoseconds>(Seconds(options.idle_seconds));
  const auto frames = static_cast<std::uint64_t>(options.fps * options.idle_seconds);
  std::vector<nanoseconds> with;
  std::vector<nanoseconds> without;
  std::uint64_t shown = 0;
  for (int round = 0; round < kViewRounds; ++round) {
    for (const bool is_viewed : {false, true}) {
      Server server(options, fmt::format("viewers-{}-{}", round, is_viewed), 1,
                    {"http.address=127.0.0.1:0"});
      std::unique_ptr<orbbuf::load::Viewers> viewers;
      if (is_viewed) {
        viewers = std::make_unique<orbbuf::load::Viewers>(server.http_port(), kViewers);
      }
      Fleet fleet(content, 1, frames, interval);
      fleet.connect(server.endpoint());
      fleet.stream(length, [] {});
      auto& all = is_viewed ? with : without;
      const auto of_round = gather(fleet, &Robot::latencies);
      all.insert(all.end(), of_round.begin(), of_round.end());
      fleet.end();
      server.end();
      if (viewers) shown += viewers->shown();
    }
  }
  const auto due = frames * kViewRounds * kViewers;
  std::printf("  %zu viewers were shown %lu of %lu images\n  without:\n", kViewers, shown, due);
  const double without_ms = report_latency("ack", without);
  std::printf("  with:\n");
  const double with_ms = report_latency("ack", with);
  std::printf("RESULT foxglove.shown_share %.4f\n",
              static_cast<double>(shown) / static_cast<double>(due));
  std::printf("RESULT foxglove.ack_p99_ratio.%zu %.3f\n", kViewers, with_ms / without_ms);
}

void run(const Options& options) {
  std::printf("load: seed %lu; %g fps, %zu bytes\n", options.seed, options.fps, options.bytes);
  const auto part = [&](const char* name, const std::string& what, auto measure) {
    if (!options.only.empty() && options.only != name) return;
    std::printf("load: %s: %s\n", name, what.c_str());
    std::fflush(stdout);
    measure(options);
  };
  part("stream", fmt::format("{} robots, {} s", options.robots, options.seconds), stream);
  if (options.idle_robots > 0) {
    part("idle",
         fmt::format("{} robots that only send their stats, {} s", options.idle_robots,
                     options.idle_seconds),
         idle);
  }
  part("resume", fmt::format("a session of {} frames, while another robot streams", kResumedFrames),
       resume);
  part("pipes",
       fmt::format("{} robots whose images a program reads as pgm, and one without, {} s", kPipes,
                   options.idle_seconds),
       pipes);
  part("viewers",
       fmt::format("a robot, with {} viewers by Foxglove's protocol and without, {} times {} s",
                   kViewers, kViewRounds, options.idle_seconds),
       viewers);
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  orbbuf::CommandLine app("Many robots and one server");
  app.add_option("--server", options.server, "orbbuf-server").required();
  app.add_option("--work", options.work, "an empty folder for all that is written").required();
  app.add_option("--robots", options.robots).in_range(1, 1e9);
  app.add_option("--fps", options.fps, "of each robot").in_range(1, 1e9);
  app.add_option("--bytes", options.bytes, "of each frame").in_range(1, 1e9);
  app.add_option("--seconds", options.seconds).in_range(1, 1e9);
  app.add_option("--idle-robots", options.idle_robots, "0: none");
  app.add_option("--idle-seconds", options.idle_seconds).in_range(1, 1e9);
  app.add_option("--seed", options.seed, "of the images");
  app.add_option("--sync", options.sync, "files.sync of the server");
  app.add_option("--only", options.only, "one part")
      .one_of({"stream", "idle", "resume", "pipes", "viewers"});
  const auto quick = [&] {
    options.seconds = 10;
    options.idle_seconds = 5;
  };
  app.add_flag("--quick", quick, "10 s, and 5 s idle");
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("load", [&] { run(options); });
}
