// SPDX-License-Identifier: Apache-2.0
// Whole sessions that real processes have delivered: how wrong the path is.
#include <fmt/core.h>

#include <algorithm>

#include "evaluation/trial/experiments.hpp"
#include "evaluation/trial/report.hpp"

namespace orbbuf::evaluation {

std::string score_paths(Scene& scene, const TrialOptions& options,
                        const std::vector<std::string>& sessions) {
  struct Path {
    Session session;
    double ratio = 0;
  };
  std::vector<Path> paths;
  for (const std::string& named : sessions) paths.push_back({read_session(named), 0});
  for_each_parallel("paths", paths.size(), [&](std::size_t i) {
    paths[i].ratio = scene.ate_ratio(paths[i].session.received);
  });
  std::ranges::stable_sort(paths, {}, [](const Path& path) { return path.session.run; });
  std::string markdown =
      "| link | | delivered | longest gap, frames | ATE ratio |\n|---|---|---|---|---|\n";
  std::string results;
  for (const auto& [session, ratio] : paths) {
    markdown += fmt::format("| {} | {} | {} of {} | {} | {} |\n", session.run, session.contender,
                            session.received.size(), scene.size(),
                            longest_gap(session.received, {0, scene.size()}), ratio_text(ratio));
    results += fmt::format("RESULT paper.real4g.{}.{}.ate_ratio {:.3f}\n", session.run,
                           session.contender, ratio);
  }
  write_text(options.out / "paths.md", markdown);
  return results;
}

}  // namespace orbbuf::evaluation
