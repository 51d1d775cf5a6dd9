// SPDX-License-Identifier: Apache-2.0
// Two real robots and a real server on a link that is cut, slowed and reset while all of them are
// killed, paused and restarted, by a seeded plan; then what became of every frame.
#include <chrono>
#include <cstdio>
#include <fstream>
#include <thread>

#include "bench/chaos/check.hpp"
#include "bench/chaos/plan.hpp"
#include "bench/chaos/stage.hpp"
#include "bench/run_program.hpp"
#include "common/command_line.hpp"

namespace {

using orbbuf::chaos::CheckResult;
using orbbuf::chaos::Stage;
using orbbuf::chaos::Step;
namespace fs = std::filesystem;

constexpr int kSkipped = 77;

struct Options {
  orbbuf::chaos::PlanSettings plan;
  orbbuf::chaos::Programs programs;
  fs::path work;
  fs::path traces;
  std::string control = "both";
  bool has_two_links = false;
  bool has_tls = false;
  bool has_spool = false;
  bool has_power_cuts = false;
};

void play(Stage& stage, const std::vector<Step>& plan, std::ostream& log) {
  const auto begin = std::chrono::steady_clock::now();
  for (const Step& step : plan) {
    std::this_thread::sleep_until(begin + std::chrono::duration_cast<std::chrono::nanoseconds>(
                                              std::chrono::duration<double>(step.at_s)));
    const std::chrono::duration<double> now = std::chrono::steady_clock::now() - begin;
    log << step.text() << "  at " << now.count() << std::endl;
    stage.apply(step);
  }
}

void report(const CheckResult& found, const Options& options, std::size_t sessions) {
  for (const std::string& problem : found.problems) std::printf("%s\n", problem.c_str());
  const auto result = [](const char* name, std::uint64_t value) {
    std::printf("RESULT chaos.%s %llu\n", name, static_cast<unsigned long long>(value));
  };
  result("seed", options.plan.seed);
  result("events", static_cast<std::uint64_t>(options.plan.events));
  result("sessions", sessions);
  result("captured", found.captured);
  result("delivered", found.delivered);
  if (options.has_spool) result("late", found.late);
  result("dropped", found.dropped);
  result("died_with_robot", found.died_with_robot);
  result("lost", found.lost);
  result("repeated", found.repeated);
  result("unexplained", found.unexplained);
}

int run(Options options) {
  std::string why;
  const std::vector<std::string> wanted = options.control == "both"
                                              ? std::vector<std::string>{"cubic", "bbr"}
                                              : std::vector<std::string>{options.control};
  const std::vector<std::string> controls = Stage::available(wanted, why);
  if (controls.size() < wanted.size()) std::fprintf(stderr, "chaos: skipped: %s\n", why.c_str());
  if (controls.empty()) return kSkipped;
  options.plan.robots = controls.size();
  options.plan.rates = orbbuf::chaos::read_rates(options.traces);
  const std::vector<Step> plan = orbbuf::chaos::make_plan(options.plan);
  std::printf("chaos: seed %llu, %d events in %.0f s, %s, %s; a robot under each of:",
              static_cast<unsigned long long>(options.plan.seed), options.plan.events,
              plan.back().at_s, options.plan.rates.empty() ? "random rates" : "recorded rates",
              options.has_tls ? "TLS" : "plain TCP");
  for (const std::string& control : controls) std::printf(" %s", control.c_str());
  std::printf("\n");
  std::fflush(stdout);

  if (options.has_power_cuts && !orbbuf::bench::PowerDisk::leave_other_mounts()) {
    std::fprintf(stderr, "chaos: skipped: this user cannot mount\n");
    return kSkipped;
  }
  Stage stage(
      options.programs, options.work, controls,
      {options.has_two_links ? 2 : 1, options.has_tls, options.has_spool, options.has_power_cuts});
  std::ofstream log(options.work / "events.txt");
  stage.begin();
  play(stage, plan, log);
  stage.end();
  const CheckResult found = orbbuf::chaos::check(stage.sessions(), stage.source());
  report(found, options, stage.sessions().size());
  return found.problems.empty() ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  orbbuf::CommandLine app("Chaos on the link, and what became of every frame");
  app.add_option("--robot", options.programs.robot, "orbbufd").required();
  app.add_option("--server", options.programs.server, "orbbuf-server").required();
  app.add_option("--work", options.work, "an empty folder for all that is written").required();
  app.add_option("--traces", options.traces, "recorded rates; else random ones");
  app.add_option("--seed", options.plan.seed);
  app.add_option("--events", options.plan.events).in_range(1, 1'000'000);
  app.add_option("--longest-outage", options.plan.longest_outage_s, "in seconds");
  app.add_flag("--long", options.plan.has_minute_outages, "outages of 60 s among them");
  app.add_option("--control", options.control).one_of({"both", "cubic", "bbr"});
  app.add_flag("--two-links", options.has_two_links,
               "link.interfaces; cuts take one, the other, both");
  app.add_flag("--tls", options.has_tls, "the link under TLS");
  app.add_flag("--spool", options.has_spool, "robots with spools: no frame is given up");
  app.add_flag("--power-cuts", options.has_power_cuts,
               "each second robot that is killed loses its disk's power, too (root)")
      .needs("--spool");
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("chaos", [&] { return run(options); });
}
