// SPDX-License-Identifier: Apache-2.0
// Runs seeds: of each the scenario, in virtual time, and then the judge.
#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <optional>
#include <sstream>
#include <stdexcept>

#include "common/command_line.hpp"
#include "common/jpeg.hpp"
#include "common/log.hpp"
#include "testing/simulation/judge.hpp"
#include "testing/simulation/run.hpp"
#include "testing/simulation/zygote.hpp"

namespace orbbuf::simulation {
namespace {

namespace fs = std::filesystem;

constexpr int kSecondsASeed = 600;  // of this machine's time; beyond that it hangs

struct Options {
  std::uint64_t seed = 1;
  std::uint64_t seeds = 1;
  std::uint64_t step = 1;
  double hours = 0;
  double minutes = 0;
  bool has_trace = false;
  bool shrinks = false;
  bool goes_on = false;
  std::string trace;
  std::string corpus;
  std::string build;
  std::vector<std::string> emulator;
};

/// What the worker has told, and keeps when it is killed.
struct Progress {
  std::uint64_t seed = 0;
  std::uint64_t seeds = 0;
  std::uint64_t failed = 0;
  double seconds = 0;  ///< virtual ones
  double robot_seconds = 0;
  std::uint64_t sessions = 0, captured = 0, delivered = 0, named = 0, too_young = 0;
  std::uint64_t faults = 0, deaths = 0, turns = 0, switches = 0;
};

struct Outcome {
  Verdict verdict;
  double seconds = 0;
};

std::string make_image(Random& random, int width, int height) {
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(width * height));
  for (auto& pixel : pixels) pixel = static_cast<std::uint8_t>(random.next() >> 56U);
  JpegCodec codec;
  const auto jpeg =
      codec.encode({pixels.data(), width, height, static_cast<std::size_t>(width), 1}, 80, false);
  if (!jpeg) throw std::runtime_error(jpeg.error().text);
  return {jpeg.value().begin(), jpeg.value().end()};
}

std::vector<Source> make_sources(const fs::path& folder) {
  constexpr std::size_t kImages = 128;
  std::vector<Source> sources(2);
  Random random{1};
  for (Source& source : sources) {
    const bool is_large = &source != &sources.front();
    source.name = is_large ? "large" : "small";
    source.giant = is_large ? 77 : kImages;  // none of the small ones
    fs::create_directories(folder / source.name);
    for (std::size_t i = 0; i < kImages; ++i) {
      const bool is_giant = i == source.giant;
      source.images.push_back(is_giant   ? make_image(random, 400, 320)
                              : is_large ? make_image(random, 160, 128)
                                         : make_image(random, 48, 48));
      std::ofstream(folder / source.name / fmt::format("{:06}.jpg", i), std::ios::binary)
          << source.images.back();
    }
  }
  return sources;
}

/// Of a worker. Its name is as long in each run, and so is what the programs say of it.
fs::path folder_of(pid_t process) {
  const fs::path memory = "/dev/shm";
  return (fs::exists(memory) ? memory : fs::temp_directory_path()) /
         fmt::format("orbbuf-simulate-{:07}", process);
}

class Worker {
 public:
  Worker(const Options& options, Progress& progress)
      : options_(options),
        progress_(progress),
        memory_(::memfd_create("orbbuf-simulation", 0)),
        folder_(folder_of(::getpid())) {
    pin();
    if (!options.trace.empty()) {
      const int file = ::open(options.trace.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND, 0644);
      if (file < 0) throw std::runtime_error("cannot create " + options.trace);
      ::dup2(file, kTraceDescriptor);
      ::close(file);  // else the programs' descriptors have other numbers than without a trace
    }
    fs::create_directories(folder_);
    world_folder = folder_.string();
    sources_ = make_sources(folder_ / "source");
    programs_.emplace(options.build, memory_, options.emulator);
  }
  ~Worker() {
    programs_.reset();
    fs::remove_all(folder_);
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  Outcome run(const Scenario& scenario) {
    const itimerval limit{{0, 0}, {kSecondsASeed, 0}};
    ::setitimer(ITIMER_REAL, &limit, nullptr);
    for (int i = 0; i < kMostMachines; ++i) fs::remove_all(folder_ / folder_name(i));
    make_world(memory_, scenario.seed);
    if (!options_.trace.empty()) world->trace = kTraceDescriptor;
    Run run(scenario, *programs_, sources_);
    run.run();
    Outcome outcome{judge(scenario, run), static_cast<double>(world->now) / 1e9};
    progress_.turns += world->turns;
    progress_.switches += world->switches;
    progress_.deaths += world->deaths;
    progress_.faults += scenario.faults.size();
    return outcome;
  }

 private:
  /// Threads that take turns are fastest on one processor.
  static void pin() {
    cpu_set_t all, one;
    if (::sched_getaffinity(0, sizeof all, &all) != 0) return;
    std::vector<int> processors;
    for (int i = 0; i < CPU_SETSIZE; ++i) {
      if (CPU_ISSET(i, &all)) processors.push_back(i);
    }
    CPU_ZERO(&one);
    CPU_SET(processors[static_cast<std::size_t>(::getpid()) % processors.size()], &one);
    ::sched_setaffinity(0, sizeof one, &one);
  }

  const Options& options_;
  Progress& progress_;
  const int memory_;
  const fs::path folder_;
  std::vector<Source> sources_;
  std::optional<Programs> programs_;
};

/// Leaves out faults as long as it still fails.
Scenario shrink(Worker& worker, Scenario scenario) {
  for (std::size_t piece = (scenario.faults.size() + 1) / 2; piece > 0; piece /= 2) {
    for (std::size_t at = 0; at < scenario.faults.size();) {
      Scenario fewer = scenario;
      const auto begin = fewer.faults.begin() + static_cast<std::ptrdiff_t>(at);
      const auto count = std::min(piece, fewer.faults.size() - at);
      fewer.faults.erase(begin, begin + static_cast<std::ptrdiff_t>(count));
      if (worker.run(fewer).verdict.problems.empty()) {
        at += piece;
      } else {
        scenario = std::move(fewer);
      }
    }
    if (piece == 1) break;
  }
  return scenario;
}

void report(const Scenario& scenario, const Verdict& verdict) {
  constexpr std::size_t kMostLines = 12;
  std::cout << to_string(scenario);
  for (std::size_t i = 0; i < std::min(kMostLines, verdict.problems.size()); ++i) {
    std::cout << "  FOUND " << verdict.problems[i] << '\n';
  }
  if (verdict.problems.size() > kMostLines) {
    std::cout << "  and " << verdict.problems.size() - kMostLines << " others\n";
  }
  std::cout << std::flush;
}

std::vector<std::uint64_t> seeds_of(const std::string& corpus) {
  std::vector<std::uint64_t> seeds;
  std::ifstream in(corpus);
  for (std::string line; std::getline(in, line);) {
    if (!line.empty() && line[0] != '#') seeds.push_back(std::stoull(line));
  }
  return seeds;
}

bool is_enough(const Options& options, const Progress& progress,
               std::chrono::steady_clock::time_point begun) {
  if (progress.failed > 0 && !options.goes_on) return true;
  if (options.minutes > 0) {
    return std::chrono::steady_clock::now() - begun >
           std::chrono::duration<double>(60 * options.minutes);
  }
  if (options.hours > 0) return progress.seconds >= options.hours * 3600;
  return progress.seeds >= options.seeds;
}

void work(const Options& options, Progress& progress, const std::vector<std::uint64_t>& corpus,
          std::chrono::steady_clock::time_point begun) {
  Worker worker(options, progress);
  while (!is_enough(options, progress, begun)) {
    const bool is_of_corpus = progress.seeds < corpus.size();
    if (!corpus.empty() && !is_of_corpus) break;
    progress.seed =
        is_of_corpus ? corpus[progress.seeds] : options.seed + options.step * progress.seeds;
    ++progress.seeds;
    Scenario scenario = draw_scenario(progress.seed);
    Outcome outcome = worker.run(scenario);
    progress.seconds += outcome.seconds;
    progress.robot_seconds += outcome.seconds * static_cast<double>(scenario.robots.size());
    const Verdict& verdict = outcome.verdict;
    progress.sessions += verdict.sessions;
    progress.captured += verdict.captured;
    progress.delivered += verdict.delivered;
    progress.named += verdict.named;
    progress.too_young += verdict.too_young;
    if (verdict.problems.empty()) continue;
    ++progress.failed;
    report(scenario, verdict);
    if (!options.shrinks) continue;
    scenario = shrink(worker, scenario);
    std::cout << "with the fewest faults:\n";
    report(scenario, worker.run(scenario).verdict);
  }
}

int simulate(const Options& options) {
  void* const shared =
      ::mmap(nullptr, sizeof(Progress), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  auto& progress = *new (shared) Progress();
  const auto corpus =
      options.corpus.empty() ? std::vector<std::uint64_t>() : seeds_of(options.corpus);
  const auto begun = std::chrono::steady_clock::now();
  while (!is_enough(options, progress, begun) &&
         (corpus.empty() || progress.seeds < corpus.size())) {
    const int process = ::fork();
    if (process == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      int status = EXIT_SUCCESS;
      try {
        work(options, progress, corpus, begun);
      } catch (const std::exception& error) {
        std::cerr << "orbbuf-simulate: " << error.what() << std::endl;
        status = 70;
      }
      ::_exit(status);
    }
    int status = 0;
    ::waitpid(process, &status, 0);
    std::error_code ignored;
    fs::remove_all(folder_of(process), ignored);
    if (status == 0) continue;
    if (WIFEXITED(status) && progress.seeds == 0) return 70;
    ++progress.failed;
    std::cout << to_string(draw_scenario(progress.seed))
              << (WIFSIGNALED(status) ? "  FOUND it hangs\n" : "  FOUND the simulator ended\n")
              << std::flush;
  }
  const double minutes =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count() / 60;
  const auto tell = [](std::string_view name, double value) {
    std::cout << fmt::format("RESULT simulation.{} {:.2f}\n", name, value);
  };
  const auto tell_with_rate = [&](std::string_view name, double value) {
    tell(name, value);
    tell(fmt::format("{}_per_minute", name), value / minutes);
  };
  std::cout << fmt::format("RESULT simulation.seeds {}\nRESULT simulation.failed {}\n",
                           progress.seeds, progress.failed);
  tell_with_rate("hours", progress.seconds / 3600);
  tell_with_rate("robot_hours", progress.robot_seconds / 3600);
  tell_with_rate("frames", static_cast<double>(progress.captured));
  tell_with_rate("faults", static_cast<double>(progress.faults));
  tell_with_rate("deaths", static_cast<double>(progress.deaths));
  tell("minutes", minutes);
  rusage used{};
  ::getrusage(RUSAGE_CHILDREN, &used);
  const double processor_minutes =
      static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) / 60 +
      static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec) / 60e6;
  tell("processor_minutes", processor_minutes);
  tell("hours_per_processor_minute", progress.seconds / 3600 / processor_minutes);
  std::cout << fmt::format(
      "sessions {}, frames captured {}, delivered {}, named {}, too young {}; turns {}, of which "
      "{} "
      "went to another thread\n",
      progress.sessions, progress.captured, progress.delivered, progress.named, progress.too_young,
      progress.turns, progress.switches);
  return progress.failed == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace orbbuf::simulation

int main(int argc, char** argv) try {
  using namespace orbbuf::simulation;  // NOLINT: of this file
  orbbuf::CommandLine app(
      "Runs robots and a server in virtual time, with faults drawn from a seed, and accounts for "
      "every frame.",
      "orbbuf-simulate");
  Options options;
  options.build =
      std::filesystem::canonical("/proc/self/exe").parent_path().parent_path().parent_path();
  app.add_option("--seed", options.seed, "The first seed").value_name("N");
  app.add_option("--seeds", options.seeds, "So many seeds").value_name("N");
  app.add_option("--step", options.step, "From a seed to the next one; 10: seeds of one kind")
      .value_name("N");
  app.add_option("--hours", options.hours, "Seeds until that much virtual time").value_name("N");
  app.add_option("--minutes", options.minutes, "Seeds for that much time of this machine")
      .value_name("N");
  app.add_option("--corpus", options.corpus, "The seeds that this file lists").value_name("FILE");
  app.add_option("--build", options.build, "Where the programs were built").value_name("FOLDER");
  app.add_option("--emulator", options.emulator, "What runs them, for another processor")
      .value_name("WORD");
  app.add_option("--trace", options.trace, "What happened, line by line").value_name("FILE");
  app.add_flag("--shrink", options.shrinks, "Of a seed that fails: find the faults that it takes");
  app.add_flag("--go-on", options.goes_on, "Do not stop at the first seed that fails");
  if (const auto status = app.parse(argc, argv)) return *status;
  if (!options.corpus.empty()) options.seeds = seeds_of(options.corpus).size();
  orbbuf::set_up_log("error");
  return simulate(options);
} catch (const std::exception& error) {
  std::cerr << "orbbuf-simulate: " << error.what() << '\n';
  return 70;
}
