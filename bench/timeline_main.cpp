// SPDX-License-Identifier: Apache-2.0
// Compares sessions that the server recorded: a table, a picture, and RESULT lines.
#include <fmt/core.h>

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "bench/session_outcome.hpp"
#include "bench/timeline_picture.hpp"
#include "common/command_line.hpp"

namespace {

using orbbuf::bench::Outage;
using orbbuf::bench::SessionOutcome;

void print_table(const std::vector<SessionOutcome>& sessions) {
  fmt::print("{:<16} {:>9} {:>10} {:>8} {:>19} {:>20}\n", "policy", "captured", "delivered",
             "dropped", "longest gap, frames", "smallest similarity");
  for (const SessionOutcome& s : sessions) {
    fmt::print("{:<16} {:>9} {:>10} {:>8} {:>19} {:>20}\n", s.label, s.frames.size(), s.delivered(),
               s.dropped(), s.longest_gap(), s.smallest_similarity());
  }
}

void print_results(const std::string& name, const std::vector<SessionOutcome>& sessions) {
  for (const SessionOutcome& s : sessions) {
    fmt::print("RESULT {}.{}.captured {}\n", name, s.label, s.frames.size());
    fmt::print("RESULT {}.{}.delivered {}\n", name, s.label, s.delivered());
    fmt::print("RESULT {}.{}.dropped {}\n", name, s.label, s.dropped());
    fmt::print("RESULT {}.{}.longest_gap {}\n", name, s.label, s.longest_gap());
    fmt::print("RESULT {}.{}.smallest_similarity {}\n", name, s.label, s.smallest_similarity());
  }
}

std::vector<SessionOutcome> read_sessions(const std::vector<std::string>& arguments) {
  std::vector<SessionOutcome> sessions;
  for (const std::string& argument : arguments) {
    const std::size_t equals = argument.find('=');
    if (equals == std::string::npos) {
      throw std::runtime_error("expected LABEL=FOLDER, got " + argument);
    }
    sessions.push_back(
        orbbuf::bench::read_session(argument.substr(0, equals), argument.substr(equals + 1)));
  }
  return sessions;
}

}  // namespace

int main(int argc, char** argv) {
  orbbuf::CommandLine app{
      "Compares sessions that orbbuf-server recorded, e.g. under different policies.",
      "orbbuf-timeline"};
  std::vector<std::string> arguments;
  std::string png;
  std::string results;
  Outage outage;
  app.add_option("sessions", arguments, "Sessions as LABEL=FOLDER").required();
  app.add_option("--png", png, "Draw the timelines into this file");
  app.add_option("--outage-begin", outage.begin_s, "When the link went down, in capture time, s");
  app.add_option("--outage-end", outage.end_s, "When it came back");
  app.add_option("--results", results, "Print RESULT lines under this name");
  if (const auto status = app.parse(argc, argv)) return *status;
  try {
    const std::vector<SessionOutcome> sessions = read_sessions(arguments);
    print_table(sessions);
    if (!png.empty()) {
      orbbuf::bench::draw_timelines(sessions, outage, png);
      fmt::print("picture: {}\n", png);
    }
    if (!results.empty()) print_results(results, sessions);
    return 0;
  } catch (const std::exception& error) {
    fmt::print(stderr, "orbbuf-timeline: {}\n", error.what());
    return 1;
  }
}
