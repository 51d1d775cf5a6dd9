// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/links.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "bench/sim/trial.hpp"

namespace orbbuf::sim {
namespace {

using namespace std::chrono_literals;

constexpr double kFps = 25;
constexpr std::size_t kFrameBytes = 400;  // a hundredth of 40 kB, and so are the links
constexpr double kScale = 0.01;
constexpr double kNeed = kFps * kFrameBytes;
constexpr std::size_t kMemory = (64U << 20) / 100;
constexpr auto kInterval = 40ms;
const char* const kPlanner = "catch-up";

std::vector<FramePtr> stream(double duration_s) {
  std::vector<FramePtr> frames;
  const auto count = static_cast<std::size_t>(duration_s * kFps);
  for (std::size_t i = 0; i < count; ++i) {
    EncodedFrame frame;
    frame.sequence = i;
    frame.capture_time_ns = std::chrono::nanoseconds(static_cast<long>(i) * kInterval).count();
    frame.jpeg.resize(kFrameBytes);
    frame.quality = kQuality;
    frames.push_back(std::make_shared<const EncodedFrame>(std::move(frame)));
  }
  return frames;
}

struct Link {
  std::string name;
  RateTrace trace;
  double scale = 1;
};

/// All that can be read, by name.
std::vector<Link> read_links(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const char* part : {"ghent", "mahimahi"}) {
    if (!exists(folder / part)) continue;
    for (const auto& entry : std::filesystem::directory_iterator(folder / part)) {
      const auto extension = entry.path().extension();
      if (extension == ".json" || extension == ".up") files.push_back(entry.path());
    }
  }
  std::ranges::sort(files);
  std::vector<Link> links;
  for (const auto& file : files) {
    const RateTrace trace = read_trace(file);
    links.push_back({trace.name, trace, kNeed / trace.mean_bytes_per_s()});
    if (file.extension() == ".up") links.push_back({trace.name + "-as-is", trace, kScale});
  }
  return links;
}

FinishTime finish_of(const RateTrace& trace, double scale) {
  return [&trace, scale](std::int64_t start_ns, std::size_t bytes) {
    return finish(trace, scale, 0, start_ns, bytes);
  };
}

/// A row of the table.
struct Entry {
  std::string name;
  Contender contender;
  Setup setup;
};

SimulatedBuffer make(const Contender& contender, const Setup& setup) {
  SimulatedBuffer buffer = contender.make(setup);
  if (buffer.planner) buffer.limits.bytes = kMemory;
  return buffer;
}

Setup make_setup(const std::function<double(int quality)>& share,
                 const PairSimilarity& similarity) {
  Setup setup;
  setup.similarity = similarity;
  setup.least_quality = kLeastQuality;
  setup.bytes_at = [share](std::size_t, int quality) {
    return static_cast<std::size_t>(std::lround(kFrameBytes * share(quality)));
  };
  return setup;
}

std::vector<Entry> entries(const Setup& setup_of_all) {
  std::vector<Entry> all;
  for (const Contender& contender : contenders()) {
    Setup setup = setup_of_all;
    if (contender.name.starts_with(kPlanner) && contender.name != kPlanner) {
      all.push_back({contender.name, contender, setup});
      continue;
    }
    if (contender.name == kPlanner) {
      all.push_back({contender.name, contender, setup});
      for (const int frames : {4, 8, 12, 1000}) {
        setup.largest_step = frames * kInterval;
        const std::string name = frames == 1000 ? "unbounded" : std::to_string(frames);
        all.push_back({contender.name + "-" + name, contender, setup});
      }
      continue;
    }
    for (const std::size_t capacity : {50U, 25U, 12U}) {
      setup.capacity = capacity;
      all.push_back({fmt::format("{}-{}", contender.name, capacity), contender, setup});
    }
  }
  return all;
}

double percentile(std::vector<double>& values, double share) {
  if (values.empty()) return std::numeric_limits<double>::infinity();
  const auto at = values.begin() + std::lround(share * static_cast<double>(values.size() - 1));
  std::ranges::nth_element(values, at);
  return *at;
}

std::string try_link(const Link& link, const std::vector<Entry>& all) {
  const std::vector<FramePtr> frames = stream(link.trace.duration_s());
  const FinishTime finish = finish_of(link.trace, link.scale);
  fmt::print("\n{}: {:.0f} s, mean {:.2f} of the need\n  {:<20} {:>9} {:>6} {:>9} {:>7} {:>7}\n",
             link.name, link.trace.duration_s(), link.trace.mean_bytes_per_s() * link.scale / kNeed,
             "policy", "delivered", "gap", "late p50", "p95", "worst");
  std::string results;
  std::string better;
  std::optional<StreamStats> planner;
  for (const Entry& entry : all) {
    const Delivery delivery = simulate(frames, finish, make(entry.contender, entry.setup));
    const StreamStats stats = measure_stream(frames, delivery);
    if (entry.name == kPlanner) planner = stats;
    fmt::print("  {:<20} {:9.3f} {:6.0f} {:9.2f} {:7.2f} {:7.2f}\n", entry.name, stats.delivered,
               stats.longest_gap, stats.late_p50_s, stats.late_p95_s, stats.late_worst_s);
    results += fmt::format(
        "RESULT sim.4g.{0}.{1}.longest_gap {2:.0f}\nRESULT sim.4g.{0}.{1}.late_p95_s {3:.3f}\n",
        link.name, entry.name, stats.longest_gap, stats.late_p95_s);
    if (stats.longest_gap < planner->longest_gap && stats.late_p95_s < planner->late_p95_s) {
      better += " " + entry.name;
    }
  }
  fmt::print("  smaller gap and smaller p95 than {}:{}\n", kPlanner,
             better.empty() ? " none" : better);
  return results;
}

/// A stream over a link of these rates, in parts of the need.
struct Story {
  std::string name;
  std::vector<RateTrace::Step> steps;
  double measured_from_s = 0;
  double believed_rate = 1;
};

std::vector<Story> stories() {
  const auto outage = [](double rate) {
    return std::vector<RateTrace::Step>{{5, rate}, {2, 0}, {20, rate}};
  };
  return {
      {"slow", {{60, 0.5}}, 3},
      {"quarter", {{60, 0.25}}, 3},
      {"slow-believed-half", {{60, 0.5}}, 3, 0.5},
      {"slow-believed-double", {{60, 0.5}}, 3, 2},
      {"outage", outage(1.5), 4},
      {"outage-believed-half", outage(1.5), 4, 0.5},
      {"outage-believed-double", outage(1.5), 4, 2},
      {"outage-again", {{5, 1.5}, {2, 0}, {0.5, 1.5}, {1, 0}, {20, 1.5}}, 4},
  };
}

/// The gaps between frames captured from measured_from_s on, but for the last second.
std::pair<std::size_t, std::size_t> extreme_gaps(const std::vector<FramePtr>& frames,
                                                 const Delivery& delivery, double first_s) {
  std::size_t least = std::numeric_limits<std::size_t>::max();
  std::size_t most = 0;
  const auto first = static_cast<std::size_t>(first_s * kFps);
  const std::size_t last = frames.size() - static_cast<std::size_t>(kFps);
  for (std::size_t k = 1; k < delivery.received.size(); ++k) {
    if (delivery.received[k - 1] < first || delivery.received[k] > last) continue;
    const std::size_t gap = delivery.received[k] - delivery.received[k - 1] - 1;
    least = std::min(least, gap);
    most = std::max(most, gap);
  }
  return {least, most};
}

std::string try_stories(const Setup& setup) {
  std::string results;
  const std::vector<Contender> all = contenders();
  const Contender& planner = *std::ranges::find(all, kPlanner, &Contender::name);
  fmt::print(
      "\n{} with live_again 1 s, after the first seconds\n  {:<24} {:>12} {:>9} {:>7} {:>7}\n",
      kPlanner, "link", "gaps", "late p50", "p95", "worst");
  for (const Story& story : stories()) {
    const RateTrace trace{story.name, story.steps};
    const std::vector<FramePtr> frames = stream(trace.duration_s());
    SimulatedBuffer buffer = make(planner, setup);
    buffer.believed_rate = story.believed_rate;
    const Delivery delivery = simulate(frames, finish_of(trace, kNeed), std::move(buffer));
    const StreamStats stats = measure_stream(frames, delivery, story.measured_from_s);
    const auto [least, most] = extreme_gaps(frames, delivery, story.measured_from_s);
    fmt::print("  {:<24} {:>7} to {:>2} {:9.2f} {:7.2f} {:7.2f}\n", story.name, least, most,
               stats.late_p50_s, stats.late_p95_s, stats.late_worst_s);
    results += fmt::format(
        "RESULT sim.link.{0}.least_gap {1}\nRESULT sim.link.{0}.longest_gap {2}\n"
        "RESULT sim.link.{0}.late_p95_s {3:.3f}\nRESULT sim.link.{0}.late_worst_s {4:.3f}\n",
        story.name, least, most, stats.late_p95_s, stats.late_worst_s);
  }
  return results;
}

}  // namespace

StreamStats measure_stream(const std::vector<FramePtr>& frames, const Delivery& delivery,
                           double first_s) {
  StreamStats stats;
  std::vector<double> late_s;
  for (std::size_t k = 0; k < delivery.received.size(); ++k) {
    const std::size_t i = delivery.received[k];
    const std::int64_t capture_ns = frames[i]->capture_time_ns;
    if (1e-9 * static_cast<double>(capture_ns) < first_s) continue;
    late_s.push_back(1e-9 * static_cast<double>(delivery.end_ns[k] - capture_ns));
    const std::size_t missing = k == 0 ? i : i - delivery.received[k - 1] - 1;
    stats.longest_gap = std::max(stats.longest_gap, static_cast<double>(missing));
  }
  stats.delivered =
      static_cast<double>(delivery.received.size()) / static_cast<double>(frames.size());
  stats.late_p50_s = percentile(late_s, 0.5);
  stats.late_p95_s = percentile(late_s, 0.95);
  stats.late_worst_s = percentile(late_s, 1);
  return stats;
}

std::string try_links(const std::filesystem::path& traces,
                      const std::function<double(int quality)>& share,
                      const PairSimilarity& similarity) {
  std::string results;
  const Setup setup = make_setup(share, similarity);
  const std::vector<Entry> all = entries(setup);
  const std::vector<Link> links = read_links(traces);
  if (links.empty()) fmt::print("skipped: no recorded links in {}\n", traces.string());
  for (const Link& link : links) results += try_link(link, all);
  return results + try_stories(setup);
}

}  // namespace orbbuf::sim
