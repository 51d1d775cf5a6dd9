// SPDX-License-Identifier: Apache-2.0
// Servers of a fleet that are killed, paused and cut off, etcd's leader too, by a seeded plan,
// while robots stream; then what became of every frame, from the joined sessions.
#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdio>
#include <fstream>
#include <future>
#include <map>
#include <memory>
#include <random>
#include <set>

#include "bench/fleet/robot.hpp"
#include "bench/fleet/stage.hpp"
#include "bench/load/content.hpp"
#include "bench/run_program.hpp"
#include "bench/watched_process.hpp"
#include "common/command_line.hpp"
#include "server/session/session_reader.hpp"
#include "testing/process.hpp"

namespace {

namespace fs = std::filesystem;
namespace asio = boost::asio;
using orbbuf::fleet_bench::Clock;
using orbbuf::fleet_bench::Robot;
using orbbuf::fleet_bench::Stage;
using Seconds = std::chrono::duration<double>;

constexpr std::chrono::seconds kPatience{90};
constexpr std::chrono::seconds kRest{5};

struct Options {
  fs::path server;
  fs::path work;
  std::uint64_t seed = 1;
  double minutes = 10;
  std::size_t robots = 48;
  std::size_t servers = 3;
  double fps = 10;
  std::size_t bytes = 6000;
  bool is_alone = false;
  bool is_calm = false;
};

std::chrono::nanoseconds nanoseconds_of(double seconds) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Seconds(seconds));
}

/// A disturbance at a time, and then its end: one server at most is away, and one member of etcd.
class Chaos {
 public:
  Chaos(asio::io_context& io, Stage& stage, std::vector<std::unique_ptr<Robot>>& robots,
        const Options& options)
      : timer_(io),
        stage_(stage),
        robots_(robots),
        log_(options.work / "events.txt"),
        random_(options.seed) {}

  void start(Clock::time_point end) {
    begun_ = Clock::now();
    end_ = end;
    next();
  }
  const std::map<std::string, int>& counts() const { return counts_; }

 private:
  double between(double least, double most) {
    return std::uniform_real_distribution<double>(least, most)(random_);
  }
  void after(double seconds, std::function<void()> run) {
    timer_.expires_after(nanoseconds_of(seconds));
    timer_.async_wait([run = std::move(run)](const auto& failed) {
      if (!failed) run();
    });
  }
  void say(const std::string& what) {
    log_ << Seconds(Clock::now() - begun_).count() << " " << what << std::endl;
  }

  void next() {
    after(between(2, 5), [this] {
      if (Clock::now() + std::chrono::seconds(20) > end_) return;
      disturb();
    });
  }
  void disturb() {
    const auto server = random_() % stage_.servers();
    const std::string name = " server " + std::to_string(server);
    const auto begin = [&](const std::string& what) {
      ++counts_[what];
      say(what + name);
    };
    const auto undo = [&](double seconds, std::function<void()> run) {
      after(seconds, [this, run = std::move(run)] {
        run();
        say("over");
        next();
      });
    };
    switch (random_() % (stage_.can_cut_off() ? 7 : 5)) {
      case 0:
        begin("kill");
        stage_.kill_server(server);
        return undo(between(1, 10), [this, server] { stage_.start_server(server); });
      case 1:
        begin("pause");
        stage_.pause_server(server);
        return undo(between(1, 12), [this, server] { stage_.resume_server(server); });
      case 2:
        ++counts_["etcd leader"];
        say("kill the leader of etcd");
        stage_.kill_etcd_leader();
        return undo(between(2, 6), [this] { stage_.start_etcd(); });
      case 3:
        ++counts_["cut"];
        say("cut links");
        for (const auto& robot : robots_) {
          if (random_() % 3 == 0) robot->cut();
        }
        return next();
      case 4:
        begin("kill, at once again");
        stage_.kill_server(server);
        stage_.start_server(server);
        return next();
      case 5:
        begin("without etcd");
        stage_.cut_off_etcd(server);
        return undo(between(3, 12), [this] { stage_.mend(); });
      default:
        begin("without robots");
        stage_.cut_off_robots(server);
        return undo(between(1, 8), [this] { stage_.mend(); });
    }
  }

  asio::steady_timer timer_;
  Stage& stage_;
  std::vector<std::unique_ptr<Robot>>& robots_;
  std::ofstream log_;
  std::mt19937_64 random_;
  Clock::time_point begun_{};
  Clock::time_point end_{};
  std::map<std::string, int> counts_;
};

struct Audit {
  std::uint64_t captured = 0;
  std::uint64_t lost = 0;
  std::uint64_t repeated = 0;
  std::uint64_t unexplained = 0;
  std::uint64_t segments = 0;
};

/// Frames of a segment below its beginning, or twice in it.
std::uint64_t count_repeats(const fs::path& segment) {
  const auto summary = orbbuf::read_summary(segment);
  const std::uint64_t from = summary ? summary->info.segment.from[orbbuf::wire::kFrames] : 0;
  std::uint64_t repeats = 0;
  std::string line;
  std::set<std::uint64_t> seen;
  std::ifstream times(segment / "times.txt");
  while (std::getline(times, line)) {
    const auto sequence = std::stoull(line);
    if (sequence < from || !seen.insert(sequence).second) ++repeats;
  }
  return repeats;
}

void audit(const Options& options, const Stage& stage, const orbbuf::load::Content& content,
           const std::vector<std::unique_ptr<Robot>>& robots, Audit& found) {
  for (std::size_t i = 0; i < robots.size(); ++i) {
    const Robot& robot = *robots[i];
    const fs::path out = options.work / "joined" / robot.id();
    std::vector<std::string> command{options.server.string(), "join",
                                     robot.id() + "/" + Robot::kSession, "--output", out.string()};
    for (std::size_t server = 0; server < stage.servers(); ++server) {
      command.push_back(stage.files(server).string());
      std::error_code none;
      for (const auto& entry : fs::directory_iterator(stage.files(server) / robot.id(), none)) {
        ++found.segments;
        found.repeated += count_repeats(entry.path());
      }
    }
    const auto joined = orbbuf::test::run(command);
    const std::uint64_t captured = robot.counts().captured;
    found.captured += captured;
    found.lost += captured - content.count_delivered(out, i, captured);
    if (joined.status == 0) continue;
    ++found.unexplained;
    std::printf("%s", joined.output.c_str());
  }
}

double share_of(std::vector<double> all, double share) {
  if (all.empty()) return 0;
  std::ranges::sort(all);
  return all[std::min(all.size() - 1,
                      static_cast<std::size_t>(share * static_cast<double>(all.size())))];
}

/// Those of all robots.
std::vector<double> times_of(const std::vector<std::unique_ptr<Robot>>& robots,
                             std::vector<double> Robot::Counts::*times) {
  std::vector<double> all;
  for (const auto& robot : robots) {
    const auto& own = robot->counts().*times;
    all.insert(all.end(), own.begin(), own.end());
  }
  return all;
}

/// Each server in turn is drained and started again.
void roll(asio::io_context& io, Stage& stage) {
  auto rolled = std::async(std::launch::async, [&stage] {
    for (std::size_t i = 0; i < stage.servers(); ++i) stage.roll(i);
  });
  using namespace std::chrono_literals;
  while (rolled.wait_for(0s) != std::future_status::ready) io.run_for(10ms);
  rolled.get();
}

void await_end(asio::io_context& io, std::vector<std::unique_ptr<Robot>>& robots) {
  std::size_t left = robots.size();
  for (const auto& robot : robots) robot->end([&left] { --left; });
  const auto limit = Clock::now() + kPatience;
  while (left > 0 && Clock::now() < limit) io.run_one_until(limit);
  if (left == 0) return;
  for (const auto& robot : robots) std::fprintf(stderr, "%s\n", robot->state().c_str());
  throw std::runtime_error(std::to_string(left) + " robots do not end");
}

/// RESULT lines with that prefix. False: a frame is not accounted for.
bool stream(const Options& options, const std::string& prefix) {
  const auto result = [&prefix](const char* name, double value) {
    std::printf("RESULT fleet.%s%s %.6g\n", prefix.c_str(), name, value);
  };
  const orbbuf::load::Content content(options.seed, options.bytes);
  Stage stage(options.server, options.work, options.servers, options.is_alone);
  asio::io_context io(1);
  std::vector<std::unique_ptr<Robot>> robots;
  const auto interval = nanoseconds_of(1 / options.fps);
  for (std::size_t i = 0; i < options.robots; ++i) {
    robots.push_back(
        std::make_unique<Robot>(io, content, Robot::Plan{i, interval, stage.endpoints()}));
  }
  std::printf("fleet: seed %lu, %zu robots, %zu servers, %zu etcd, %g min, %g fps of %zu bytes%s\n",
              options.seed, options.robots, options.servers, stage.etcd().size(), options.minutes,
              options.fps, options.bytes, stage.can_cut_off() ? ", partitions" : "");
  std::fflush(stdout);
  const auto begin = Clock::now();
  const auto end = begin + nanoseconds_of(60 * options.minutes);
  for (std::size_t i = 0; i < robots.size(); ++i) {
    robots[i]->start(begin + static_cast<std::int64_t>(i) * interval /
                                 static_cast<std::int64_t>(robots.size()));
  }
  const auto revision = stage.etcd_revision();
  const orbbuf::bench::WatchedProcess first(stage.pid(0));
  Chaos chaos(io, stage, robots, options);
  const auto cpu_before = first.cpu_time();
  if (!options.is_calm) chaos.start(end);
  io.run_until(end);
  if (options.is_calm) {
    const Seconds took = Clock::now() - begin;
    result("server_cores", Seconds(first.cpu_time() - cpu_before) / took);
    result("etcd_writes_per_s",
           static_cast<double>(stage.etcd_revision() - revision) / took.count());
    const auto acks = times_of(robots, &Robot::Counts::acks_s);
    result("ack_s_median", share_of(acks, 0.5));
    result("ack_s_p99", share_of(acks, 0.99));
  }
  std::vector<double> gaps;
  std::vector<double> drain_gaps;
  if (stage.servers() > 1) {
    io.run_for(kRest);  // what the last disturbance has left
    gaps = times_of(robots, &Robot::Counts::gaps_s);
    for (const auto& robot : robots) robot->forget_gaps();
    roll(io, stage);
    drain_gaps = times_of(robots, &Robot::Counts::gaps_s);
  }
  await_end(io, robots);
  stage.end();

  Audit found;
  audit(options, stage, content, robots, found);
  std::uint64_t split_brain = 0;
  for (const auto& robot : robots) {
    const auto& counts = robot->counts();
    split_brain += counts.split_brain;
    found.unexplained += counts.forgotten;
  }
  for (const auto& [what, count] : chaos.counts()) std::printf("  %s: %d\n", what.c_str(), count);
  result("seed", static_cast<double>(options.seed));
  result("captured", static_cast<double>(found.captured));
  result("lost", static_cast<double>(found.lost));
  result("repeated", static_cast<double>(found.repeated));
  result("unexplained", static_cast<double>(found.unexplained));
  if (stage.servers() > 1) {
    result("split_brain", static_cast<double>(split_brain));
    result("segments", static_cast<double>(found.segments));
    result("hand_overs", static_cast<double>(gaps.size()));
    result("gap_s_median", share_of(gaps, 0.5));
    result("gap_s_p90", share_of(gaps, 0.9));
    result("drained", static_cast<double>(drain_gaps.size()));
    result("drain_gap_s_median", share_of(drain_gaps, 0.5));
    result("drain_gap_s_max", share_of(drain_gaps, 1));
  }
  if (!options.is_calm) {
    result("ack_s_p99", share_of(times_of(robots, &Robot::Counts::acks_s), 0.99));
  }
  return found.lost + found.repeated + found.unexplained + split_brain == 0 && found.captured > 0;
}

/// What coordination costs: beside the fleet, before it, one server with its share of the robots.
int run(const Options& options) {
  if (!options.is_calm) return stream(options, "") ? EXIT_SUCCESS : EXIT_FAILURE;
  Options single = options;
  single.servers = 1;
  single.robots = options.robots / options.servers;
  single.work = options.work / "single";
  const bool is_good = stream(single, "single.");
  return stream(options, "") && is_good ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  orbbuf::CommandLine app("Chaos among the servers of a fleet, and what became of every frame");
  app.add_option("--server", options.server, "orbbuf-server").required();
  app.add_option("--work", options.work, "an empty folder for all that is written").required();
  app.add_option("--seed", options.seed);
  app.add_option("--minutes", options.minutes).in_range(0.01, 1e6);
  app.add_option("--robots", options.robots).in_range(1, 1e9);
  app.add_option("--servers", options.servers).in_range(2, 9);
  app.add_option("--fps", options.fps).in_range(0.01, 1e6);
  app.add_option("--bytes", options.bytes).in_range(1, 1e9);
  app.add_flag("--alone", options.is_alone, "in a network of its own, so that it can be cut");
  app.add_flag("--calm", options.is_calm,
               "no chaos: what coordination costs, beside one server that is in no fleet");
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("fleet", [&] { return run(options); });
}
