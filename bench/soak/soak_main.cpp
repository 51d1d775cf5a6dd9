// SPDX-License-Identifier: Apache-2.0
// A real robot that captures at four times the usual rate, and a real server, through one short
// outage after the other: the memory of both, which must not grow, and what became of every frame.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <thread>
#include <vector>

#include "bench/chaos/check.hpp"
#include "bench/run_program.hpp"
#include "bench/watched_process.hpp"
#include "common/command_line.hpp"
#include "testing/namespaces.hpp"
#include "testing/process.hpp"

namespace {

namespace fs = std::filesystem;
using orbbuf::bench::WatchedProcess;
using orbbuf::chaos::CheckResult;
using orbbuf::test::Namespaces;
using orbbuf::test::Process;
using orbbuf::test::with_settings;
using orbbuf::test::word_after;
using Clock = std::chrono::steady_clock;
using Words = std::vector<std::string>;

constexpr int kSkipped = 77;
constexpr std::int64_t kMostGrowthKib = 1024;
constexpr std::chrono::seconds kSampling{1};

struct Options {
  std::string robot;
  std::string server;
  fs::path work;
  double minutes = 5;
  double fps = 100;
  std::uint64_t seed = 1;
};

/// Now and then the link loses everything for up to two seconds, which is twice the buffer's
/// time at 25 frames a second and eight times that at 100.
class Outages {
 public:
  Outages(const Namespaces& hosts, std::uint64_t seed) : hosts_(hosts), random_(seed) { plan(); }
  /// By the clock: cuts or mends the link if it is time to.
  void apply(Clock::time_point now) {
    if (now < next_) return;
    is_cut_ ? hosts_.mend_link() : hosts_.cut_link();
    count_ += is_cut_ ? 0 : 1;
    is_cut_ = !is_cut_;
    plan();
  }
  void end() {
    if (is_cut_) hosts_.mend_link();
  }
  Clock::time_point next() const { return next_; }
  int count() const { return count_; }

 private:
  void plan() {
    const double seconds = is_cut_ ? std::uniform_real_distribution(0.1, 2.0)(random_)
                                   : std::uniform_real_distribution(1.0, 6.0)(random_);
    next_ = Clock::now() +
            std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }

  const Namespaces& hosts_;
  std::mt19937_64 random_;
  bool is_cut_ = false;
  Clock::time_point next_;
  int count_ = 0;
};

/// A process' resident memory, second by second.
class Memory {
 public:
  Memory(const char* name, const Process& process) : name_(name), watched_(process.pid()) {}

  void sample() { kib_.push_back(static_cast<std::int64_t>(watched_.resident_kib())); }
  /// From the third tenth of the time to the last: medians, since pages come and go.
  std::int64_t growth_kib() const { return median(0.9, 1) - median(0.2, 0.3); }
  void print() const {
    std::printf("  %s: %ld KiB at first, %ld after a fifth of the time, %ld at the end\n", name_,
                kib_.front(), median(0.2, 0.3), median(0.9, 1));
  }

 private:
  std::int64_t median(double from, double to) const {
    const auto at = [this](double part) {
      return kib_.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(kib_.size()));
    };
    std::vector<std::int64_t> part(at(from), std::max(at(to), at(from) + 1));
    std::ranges::sort(part);
    return part[part.size() / 2];
  }

  const char* name_;
  WatchedProcess watched_;
  std::vector<std::int64_t> kib_;
};

struct Outcome {
  CheckResult check;
  int outages = 0;
  std::int64_t robot_growth_kib = 0;
  std::int64_t server_growth_kib = 0;
};

void run_for(std::chrono::duration<double> time, Outages& outages, Memory& robot, Memory& server) {
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(time);
  for (auto sampling = Clock::now(); Clock::now() < end;) {
    outages.apply(Clock::now());
    if (Clock::now() >= sampling) {
      robot.sample();
      server.sample();
      sampling += kSampling;
    }
    std::this_thread::sleep_until(std::min({sampling, outages.next(), end}));
  }
  outages.end();
}

void end(Process& process) {
  process.signal(SIGTERM);
  if (process.wait() != 0) throw std::runtime_error("ended badly: " + process.output());
}

Outcome soak(const Options& options, const Namespaces& hosts) {
  Words server_command = hosts.on_server();
  server_command.push_back(options.server);
  Process server(with_settings(
      server_command,
      {"listen.insecure=true", "listen.address=" + std::string(Namespaces::kServerListen),
       "files.path=" + (options.work / "out").string()}));
  const std::string address = word_after(server.require_line("listening on "), "listening on ");
  orbbuf::chaos::Session session;
  session.log = options.work / "robot.log";
  const std::filesystem::path drops = options.work / "drops";
  Words robot_command = hosts.on_robot();
  robot_command.push_back(options.robot);
  Process robot(with_settings(
      robot_command,
      {"robot.id=r", "link.server=" + address, "link.drain_timeout=1 min",
       "source.fps=" + std::to_string(options.fps), "source.width=320", "source.height=240",
       "source.frames=1000000000", "buffer.drop_log=" + drops.string()}));
  session.name = word_after(robot.require_line(", session "), ", session ");
  session.files = options.work / "out" / "r" / session.name;
  robot.require_line("connected to ");

  Outages outages(hosts, options.seed);
  Memory robot_memory("orbbufd", robot);
  Memory server_memory("orbbuf-server", server);
  run_for(std::chrono::duration<double>(60 * options.minutes), outages, robot_memory,
          server_memory);
  end(robot);
  end(server);
  std::ofstream(session.log) << robot.output();
  robot_memory.print();
  server_memory.print();
  return {orbbuf::chaos::check({session}, {}), outages.count(), robot_memory.growth_kib(),
          server_memory.growth_kib()};
}

int run(const Options& options) {
  const Namespaces hosts;
  if (!hosts.exist()) {
    std::fprintf(stderr, "soak: skipped: %s\n", hosts.why().c_str());
    return kSkipped;
  }
  std::printf("soak: seed %lu, %g minutes, %g frames a second\n", options.seed, options.minutes,
              options.fps);
  std::fflush(stdout);
  const Outcome outcome = soak(options, hosts);
  for (const std::string& problem : outcome.check.problems) std::printf("%s\n", problem.c_str());
  const auto result = [](const char* name, auto value) {
    std::printf("RESULT soak.%s %lld\n", name, static_cast<long long>(value));
  };
  result("outages", outcome.outages);
  result("captured", outcome.check.captured);
  result("delivered", outcome.check.delivered);
  result("dropped", outcome.check.dropped);
  result("lost", outcome.check.lost);
  result("repeated", outcome.check.repeated);
  result("unexplained", outcome.check.unexplained);
  result("robot_growth_kib", outcome.robot_growth_kib);
  result("server_growth_kib", outcome.server_growth_kib);
  const bool is_flat =
      std::max(outcome.robot_growth_kib, outcome.server_growth_kib) <= kMostGrowthKib;
  if (!is_flat) std::printf("memory grows by more than %ld KiB\n", kMostGrowthKib);
  return is_flat && outcome.check.problems.empty() ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  orbbuf::CommandLine app("Memory and what became of every frame, over a long time");
  app.add_option("--robot", options.robot, "orbbufd").required();
  app.add_option("--server", options.server, "orbbuf-server").required();
  app.add_option("--work", options.work, "an empty folder for all that is written").required();
  app.add_option("--minutes", options.minutes).in_range(0.01, 1e6);
  app.add_option("--fps", options.fps).in_range(0.01, 1e6);
  app.add_option("--seed", options.seed, "of the outages");
  app.add_flag(
      "--long", [&] { options.minutes = 120; }, "two hours");
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("soak", [&] { return run(options); });
}
