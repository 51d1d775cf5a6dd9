// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "daemon/buffer/make_policy.hpp"
#include "evaluation/trial/scene.hpp"

namespace orbbuf::evaluation {

struct TrialOptions {
  std::filesystem::path out;  ///< folder for NAME.csv and NAME.md
  std::uint64_t seed = 1;
  std::size_t places = 20;
  std::vector<double> outages_s = {1, 2, 3, 4};
  std::size_t capacity = 25;                ///< of the buffer, frames; but for the traces
  double rate = 2;                          ///< of the link, as a multiple of what the stream needs
  std::size_t repeats = 3;                  ///< starts within each trace
  std::vector<double> needs = {0.5, 1, 2};  ///< of the stream, as multiples of a trace's mean
  std::vector<std::filesystem::path> traces;  ///< as read_trace() takes them; Ghent's are scaled
  std::vector<std::string> policies{kPolicies.begin(), kPolicies.end()};
  std::vector<std::size_t> buffers = {20};  ///< traces: frames; the tables are of the first
  std::string result = "paper.real";        ///< sessions: first words of the RESULT lines
};

/// Each runs an experiment on a simulated link with the policies of orbbufd, tracks the camera with
/// what came through, writes its files to options.out and returns RESULT lines. The same for the
/// same seed.

/// Sec. IV-A: one outage, its beginning at `places` evenly along the way.
std::string try_interruptions(Scene& scene, const TrialOptions& options);
/// Sec. IV-B, fig. "buf": the smallest buffer with which 95 % of the places survive an outage of 3
/// s; no result for a policy that needs more than 95 frames. `catch-up` has no limit in frames: it
/// gets the lateness that such a buffer makes on this link, and may take any step for it.
std::string try_buffers(Scene& scene, const TrialOptions& options);
/// Sec. IV-B: the links of moving cars.
std::string try_traces(Scene& scene, const TrialOptions& options);
/// Sec. IV-B: how long each frame's push takes on the link of the first trace, under `orbbuf`
/// with its own features. The one experiment that is not the same for the same seed.
std::string time_enqueue(Scene& scene, const TrialOptions& options);
/// Sec. III-F: similarity by distance, and how many missing frames in a row lose the reference
/// VO, by the first.
std::string try_tolerance(Scene& scene, const TrialOptions& options);

/// What real processes have delivered: scored around each outage. outages: a file with a line
/// NAME FIRST LAST for each, frames captured as the link went and came back. `sessions`: as
/// read_session() takes them.
std::string score_sessions(Scene& scene, const TrialOptions& options,
                           const std::filesystem::path& outages,
                           const std::vector<std::string>& sessions);
/// The same, scored as a whole; a session's run is named after its trace.
std::string score_paths(Scene& scene, const TrialOptions& options,
                        const std::vector<std::string>& sessions);

}  // namespace orbbuf::evaluation
