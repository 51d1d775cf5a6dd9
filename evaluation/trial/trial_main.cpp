// SPDX-License-Identifier: Apache-2.0
// orbbuf-trial: the paper's experiments on a folder of orbbuf-world; see experiments.hpp.
#include <fmt/core.h>

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "bench/run_program.hpp"
#include "common/command_line.hpp"
#include "evaluation/trial/experiments.hpp"

namespace {

using namespace orbbuf::evaluation;  // NOLINT(google-build-using-namespace)

struct Options {
  std::filesystem::path world;
  std::vector<std::string> experiments;
  std::filesystem::path outages;
  std::vector<std::string> sessions;
  TrialOptions trial;
};

void run(const Options& options) {
  std::filesystem::create_directories(options.trial.out);
  Scene scene(options.world);
  const TrajectoryError error = scene.error(scene.unbroken().trajectory, Stretch{0, scene.size()});
  fmt::print("unbroken: {}\n", to_text(scene.unbroken(), error));
  const std::set<std::string> wanted(options.experiments.begin(), options.experiments.end());
  std::string results;
  if (wanted.contains("tolerance")) results += try_tolerance(scene, options.trial);
  if (wanted.contains("interruption")) results += try_interruptions(scene, options.trial);
  if (wanted.contains("buffer")) results += try_buffers(scene, options.trial);
  if (wanted.contains("traces")) results += try_traces(scene, options.trial);
  if (wanted.contains("enqueue")) results += time_enqueue(scene, options.trial);
  if (wanted.contains("sessions")) {
    results += score_sessions(scene, options.trial, options.outages, options.sessions);
  }
  if (wanted.contains("paths")) results += score_paths(scene, options.trial, options.sessions);
  fmt::print("{}", results);
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  orbbuf::CommandLine app("The paper's experiments, on a generated world and a simulated link");
  app.add_option("world", options.world, "folder of orbbuf-world").required();
  app.add_option("--run", options.experiments)
      .one_of({"tolerance", "interruption", "buffer", "traces", "enqueue", "sessions", "paths"})
      .required();
  app.add_option("--out", options.trial.out, "folder for tables and CSV").required();
  app.add_option("--seed", options.trial.seed).with_default();
  app.add_option("--places", options.trial.places, "along the way").with_default();
  app.add_option("--outages", options.trial.outages_s, "seconds; interruption only").with_default();
  app.add_option("--capacity", options.trial.capacity, "frames").with_default();
  app.add_option("--repeats", options.trial.repeats, "starts in a trace").with_default();
  app.add_option("--needs", options.trial.needs, "of the stream, in means of a trace")
      .with_default();
  app.add_option("--traces", options.trial.traces, "files; report_*.json are scaled");
  app.add_option("--policies", options.trial.policies, "these only, on simulated links")
      .one_of(options.trial.policies);
  app.add_option("--buffers", options.trial.buffers, "traces: frames; the first: for the tables")
      .with_default();
  app.add_option("--result", options.trial.result, "sessions: first words of the RESULT lines")
      .with_default();
  app.add_option("--outage-list", options.outages, "sessions: lines NAME FIRST LAST (frames)");
  app.add_option("--session", options.sessions, "sessions, paths: CONTENDER@RUN=FOLDER");
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("orbbuf-trial", [&] { run(options); });
}
