// SPDX-License-Identifier: Apache-2.0
#include "evaluation/outages/list_maker.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include "bench/sim/oracle.hpp"
#include "bench/sim/trial.hpp"
#include "daemon/buffer/make_policy.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kTolerance = 1e-6;
constexpr std::size_t kLeastCapacity = 3;
constexpr std::size_t kLargestCapacity = 1000;

using sim::to_ns;
using sim::to_s;

/// The trace from `offset_s` on, at rates multiplied with `scale`, and nothing during the outage.
sim::RateTrace with_outage(const sim::RateTrace& trace, double scale, double offset_s,
                           const OutagePlan& plan, double end_s) {
  sim::RateTrace cut{trace.name, {}};
  double into_s = std::fmod(offset_s, trace.duration_s());
  std::size_t step = 0;
  while (step + 1 < trace.steps.size() && into_s >= trace.steps[step].duration_s) {
    into_s -= trace.steps[step++].duration_s;
  }
  const double return_s = plan.begin_s + plan.length_s;
  for (double now_s = 0; now_s < end_s;) {
    const bool is_down = now_s >= plan.begin_s && now_s < return_s;
    const double next_s = now_s < plan.begin_s ? plan.begin_s : is_down ? return_s : end_s;
    const double rest_s = std::min(trace.steps[step].duration_s - into_s, next_s - now_s);
    cut.steps.push_back({rest_s, is_down ? 0 : scale * trace.steps[step].bytes_per_s});
    into_s += rest_s;
    now_s = rest_s < next_s - now_s ? now_s + rest_s : next_s;
    if (into_s >= trace.steps[step].duration_s) {
      into_s = 0;
      step = (step + 1) % trace.steps.size();
    }
  }
  return cut;
}

/// The first `count` sends.
sim::Delivery first_of(sim::Delivery delivery, std::size_t count) {
  delivery.received.resize(count);
  delivery.begin_ns.resize(count);
  delivery.end_ns.resize(count);
  delivery.quality.resize(count);
  return delivery;
}

}  // namespace

Link read_link(const std::string& text, const std::filesystem::path& traces) {
  const auto colon = text.rfind(':');
  const std::string name = text.substr(0, colon);
  std::size_t used = 0;
  Link link{
      fmt::format("{}-{}", std::filesystem::path(name).stem().string(), text.substr(colon + 1)),
      {},
      0};
  if (colon != std::string::npos) link.need = std::stod(text.substr(colon + 1), &used);
  if (used == 0 || used + colon + 1 != text.size() || link.need <= 0) {
    throw std::runtime_error(text + ": not constant:RATE or FILE:RATE");
  }
  link.trace = name == "constant" ? sim::RateTrace{name, {{1, 1}}} : sim::read_trace(traces / name);
  return link;
}

Places place_outages(double sequence_s, double length_s, std::size_t count, double lead_s,
                     double tail_s) {
  const bool fits = sequence_s >= lead_s + length_s + tail_s + 1;
  const double last_s = fits ? sequence_s - length_s - tail_s : lead_s + sequence_s;
  Places places;
  places.played_s = last_s + length_s + tail_s;
  for (std::size_t i = 0; i < count; ++i) {
    const double share = count == 1 ? 0 : static_cast<double>(i) / static_cast<double>(count - 1);
    places.begin_s.push_back(lead_s + share * (last_s - lead_s));
  }
  return places;
}

/// One outage of one link.
struct ListMaker::Problem {
  OutagePlan plan;
  sim::FinishTime finish;
  std::vector<FramePtr> frames;  // those that are captured meanwhile

  double return_s() const { return plan.begin_s + plan.length_s; }
};

std::vector<std::string> ListMaker::policies() {
  std::vector<std::string> names(kPolicies.begin(), kPolicies.end());
  names.insert(names.end(), {"oracle", "unbroken"});
  return names;
}

ListMaker::ListMaker(sim::RecordedSequence& sequence, std::vector<std::string> images,
                     std::string sha256, double played_s)
    : sequence_(sequence),
      images_(std::move(images)),
      sha256_(std::move(sha256)),
      stage_(sequence, std::max(played_s, to_s(sequence.frames().back()->capture_time_ns))) {
  if (images_.size() != sequence_.size()) {
    throw std::runtime_error(fmt::format("{}: {} images, but {} frames", sequence_.name(),
                                         images_.size(), sequence_.size()));
  }
}

sim::Delivery ListMaker::simulate(const std::string& policy, std::size_t capacity,
                                  const Problem& problem) {
  sim::Setup setup;
  setup.capacity = capacity;
  setup.live_again = std::chrono::nanoseconds(to_ns(problem.plan.lateness_s));
  setup.seed = problem.plan.seed;
  setup.least_quality = sim::kLeastQuality;
  setup.bytes_at = [this](std::size_t frame, int quality) {
    return stage_.bytes_at(frame, quality);
  };
  setup.interval_s = to_s(std::llround(sequence_.mean_interval_ns()));
  setup.similarity = [this](std::size_t i, std::size_t j) { return stage_.similarity(i, j); };
  return sim::simulate(problem.frames, problem.finish, sim::contender(policy).make(setup));
}

double ListMaker::live_again_s(const sim::Delivery& delivery, const Problem& problem) const {
  return sim::live_again_s(stage_.frames(), delivery.received, delivery.begin_ns,
                           to_ns(problem.return_s()))
      .value_or(INFINITY);
}

/// The largest with which a FIFO is live again in time: it is later the more frames it keeps.
std::size_t ListMaker::capacity_for(const Problem& problem) {
  std::size_t low = kLeastCapacity;
  std::size_t high = kLargestCapacity;
  while (low < high) {
    const std::size_t middle = (low + high + 1) / 2;
    const double late_s = live_again_s(simulate("drop-oldest", middle, problem), problem);
    (late_s <= problem.plan.lateness_s ? low : high) =
        late_s <= problem.plan.lateness_s ? middle : middle - 1;
  }
  return low;
}

sim::Delivery ListMaker::unbroken(const Problem& problem) {
  sim::Delivery delivery;
  for (const FramePtr& frame : problem.frames) {
    delivery.received.push_back(frame->sequence);
    delivery.begin_ns.push_back(frame->capture_time_ns);
    delivery.end_ns.push_back(frame->capture_time_ns);
    delivery.quality.push_back(frame->quality);
  }
  return delivery;
}

/// After what `catch-up` sends before the return; and every frame once the stream is live.
sim::Delivery ListMaker::by_oracle(const Problem& problem) {
  sim::Delivery delivery = simulate("catch-up", kLeastCapacity, problem);
  const auto before = std::ranges::lower_bound(delivery.begin_ns, to_ns(problem.return_s()));
  const auto sent_before = static_cast<std::size_t>(before - delivery.begin_ns.begin());
  delivery = first_of(std::move(delivery), sent_before);
  if (delivery.received.empty()) throw std::runtime_error("nothing is sent before the outage");
  const sim::BytesAt bytes_at = [this](std::size_t frame, int quality) {
    return stage_.bytes_at(frame, quality);
  };
  sim::OracleProblem asked{stage_.frames(), problem.finish};
  asked.last = delivery.received.back();
  asked.last_begin_ns = delivery.begin_ns.back();
  asked.last_bytes = bytes_at(asked.last, delivery.quality.back());
  asked.deadline_ns = to_ns(problem.return_s() + problem.plan.lateness_s);
  const auto best = sim::oracle(
      asked, bytes_at, sim::oracle_qualities(),
      [this](std::size_t i, std::size_t j) { return stage_.time_s(j) - stage_.time_s(i); }, true,
      kTolerance);
  if (!best) return delivery;
  const auto send = [&](std::size_t frame, int quality) {
    const std::int64_t begin_ns =
        std::max(delivery.end_ns.back(), stage_.frames()[frame]->capture_time_ns);
    delivery.received.push_back(frame);
    delivery.begin_ns.push_back(begin_ns);
    delivery.end_ns.push_back(problem.finish(begin_ns, bytes_at(frame, quality)));
    delivery.quality.push_back(quality);
  };
  for (const std::size_t frame : best->path.frames) send(frame, best->quality);
  while (delivery.received.back() < problem.frames.back()->sequence) {
    send(delivery.received.back() + 1, sim::kQuality);
  }
  return delivery;
}

std::vector<OutageList> ListMaker::make(const std::vector<std::string>& policies, const Link& link,
                                        const OutagePlan& plan) {
  constexpr double kAfterS = 60;  // until the last byte has passed
  const double end_s = plan.begin_s + plan.length_s + plan.lateness_s + plan.tail_s;
  const double need = sequence_.mean_jpeg_bytes() / (sequence_.mean_interval_ns() * 1e-9);
  const double offset_s = to_s(static_cast<std::int64_t>(plan.seed) * 7'000'000'000);
  const auto trace = with_outage(link.trace, link.need * need / link.trace.mean_bytes_per_s(),
                                 offset_s, plan, end_s + kAfterS);
  Problem problem{plan, {}, {}};
  problem.finish = [&trace](std::int64_t start_ns, std::size_t bytes) {
    return sim::finish(trace, 1, 0, start_ns, bytes);
  };
  for (const FramePtr& frame : stage_.frames()) {
    const double at_s = to_s(frame->capture_time_ns);
    if (at_s >= plan.begin_s - plan.lead_s && at_s < end_s) problem.frames.push_back(frame);
  }
  std::optional<std::size_t> capacity;  // of all that need one: sought once
  std::vector<OutageList> lists;
  for (const std::string& policy : policies) {
    sim::Delivery delivery;
    if (policy == "oracle") {
      delivery = by_oracle(problem);
    } else if (policy == "unbroken") {
      delivery = unbroken(problem);
    } else if (policy == "catch-up") {
      delivery = simulate(policy, kLeastCapacity, problem);
    } else {
      if (!capacity) capacity = capacity_for(problem);
      delivery = simulate(policy, *capacity, problem);
    }
    OutageList& list = lists.emplace_back(OutageList{sequence_.name(),
                                                     sha256_,
                                                     policy,
                                                     link.name,
                                                     plan.lateness_s,
                                                     live_again_s(delivery, problem),
                                                     plan.begin_s,
                                                     plan.length_s,
                                                     {}});
    for (std::size_t k = 0; k < delivery.received.size(); ++k) {
      const std::size_t number = delivery.received[k];
      list.arrivals.push_back({images_[stage_.origin(number)], number, stage_.time_s(number),
                               to_s(delivery.end_ns[k]), delivery.quality[k]});
    }
  }
  return lists;
}

}  // namespace orbbuf::evaluation
