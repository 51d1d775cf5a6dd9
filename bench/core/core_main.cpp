// SPDX-License-Identifier: Apache-2.0
// orbbuf-core-bench: what an enqueue costs, as a ratio to the baseline, plain OpenCV, in the same
// run; and what reducing a JPEG costs, as a ratio to encoding one. Everything on one thread, in
// that thread's own time.
#include <benchmark/benchmark.h>
#include <fmt/core.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <string>
#include <vector>

#include "bench/core/requantising.hpp"
#include "bench/run_program.hpp"
#include "bench/sim/recorded_sequence.hpp"
#include "common/jpeg.hpp"
#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/buffer/orb_policy.hpp"
#include "daemon/buffer/similarity.hpp"
#include "daemon/image/orb_extractor.hpp"

namespace orbbuf {
namespace {

constexpr int kRepetitions = 12;  // interleaved at random; the fastest counts
constexpr int kPushes = 40;
constexpr std::size_t kCapacity = 10;

/// To and fro through the sequence, so that neighbours in the stream are neighbours in the world.
std::size_t to_and_fro(std::size_t i, std::size_t count) {
  const std::size_t period = 2 * (count - 1);
  return std::min(i % period, period - i % period);
}

/// Numbered anew, since the policy knows a frame by its sequence number.
FramePtr renumbered(const sim::RecordedSequence& sequence, std::size_t i) {
  EncodedFrame frame = *sequence.frames()[to_and_fro(i, sequence.size())];
  frame.sequence = i;
  frame.capture_time_ns = static_cast<std::int64_t>(i) * 40'000'000;
  return std::make_shared<const EncodedFrame>(std::move(frame));
}

cv::Mat rows_of(const FeatureSet& set) {
  cv::Mat rows(static_cast<int>(set.descriptors.size()), 32, CV_8UC1);
  if (!rows.empty()) std::memcpy(rows.data, set.descriptors.data(), rows.total());
  return rows;
}

/// cv::ORB on the full image, then three cross-checked matches: of the new frame with the one
/// before, and what a drop makes neighbours of.
void plain_enqueue(benchmark::State& state, const sim::RecordedSequence& sequence) {
  JpegCodec codec;
  std::vector<GrayImage> images;
  for (const FramePtr& frame : sequence.frames()) {
    images.push_back(codec.decode_gray(frame->jpeg, 1).value());
  }
  const auto orb = cv::ORB::create(500, 1.2F, 8);
  const cv::BFMatcher matcher(cv::NORM_HAMMING, true);
  std::vector<cv::Mat> last(3);
  std::size_t next = 0;
  const auto enqueue = [&] {
    GrayImage& gray = images[to_and_fro(next, images.size())];
    const cv::Mat image(gray.height_px, gray.width_px, CV_8UC1, gray.pixels.data());
    std::vector<cv::KeyPoint> points;
    cv::Mat rows;
    orb->detectAndCompute(image, cv::noArray(), points, rows);
    if (next >= last.size()) {
      for (const cv::Mat& other : last) {
        std::vector<cv::DMatch> matches;
        matcher.match(rows, other, matches);
        benchmark::DoNotOptimize(matches.data());
      }
    }
    last[next++ % last.size()] = rows;
  };
  while (next < last.size()) enqueue();
  while (state.KeepRunning()) enqueue();
}

/// push() into a full buffer under `orbbuf`: each costs an extraction, up to three M() and a drop.
void enqueue(benchmark::State& state, const sim::RecordedSequence& sequence) {
  OrbExtractor extractor(FeatureSettings{});
  int extractions = 0;
  int comparisons = 0;
  FrameBuffer buffer({kCapacity}, std::make_unique<OrbPolicy>(
                                      [&](const EncodedFrame& frame, FeatureSet& features) {
                                        ++extractions;
                                        extractor.extract(frame, features);
                                      },
                                      [&](const FeatureSet& a, const FeatureSet& b) {
                                        ++comparisons;
                                        return similarity(a, b);
                                      }));
  std::vector<FramePtr> frames;
  for (std::size_t i = 0; i < 3 * kCapacity + kPushes; ++i) {
    frames.push_back(renumbered(sequence, i));
  }
  std::size_t next = 0;
  const auto push = [&] {
    buffer.on_captured();
    buffer.push(frames[next++]);
  };
  push();
  buffer.take();
  while (next < 3 * kCapacity) {
    push();
    while (buffer.prepare()) {
    }
  }
  extractions = comparisons = 0;
  while (state.KeepRunning()) push();
  state.counters["ORB"] = static_cast<double>(extractions) / kPushes;
  state.counters["M"] = static_cast<double>(comparisons) / kPushes;
}

void plain_match(benchmark::State& state, const sim::RecordedSequence& sequence) {
  const cv::Mat a = rows_of(sequence.features(0));
  const cv::Mat b = rows_of(sequence.features(1));
  const cv::BFMatcher matcher(cv::NORM_HAMMING, true);
  while (state.KeepRunning()) {
    std::vector<cv::DMatch> matches;
    matcher.match(a, b, matches);
    benchmark::DoNotOptimize(matches.data());
  }
}

void match(benchmark::State& state, const sim::RecordedSequence& sequence) {
  state.counters["features"] = static_cast<double>(sequence.features(0).descriptors.size());
  while (state.KeepRunning()) {
    benchmark::DoNotOptimize(similarity(sequence.features(0), sequence.features(1)));
  }
}

/// All that the buffer does for a frame when the link keeps up.
void steady(benchmark::State& state, const sim::RecordedSequence& /*sequence*/) {
  OrbExtractor extractor(FeatureSettings{});
  FrameBuffer buffer({kCapacity}, std::make_unique<OrbPolicy>(
                                      [&](const EncodedFrame& frame, FeatureSet& features) {
                                        extractor.extract(frame, features);
                                      }));
  std::vector<FramePtr> frames;
  for (std::size_t i = 0; i < 1000; ++i) {
    EncodedFrame frame;
    frame.sequence = i;
    frame.jpeg = std::vector<std::uint8_t>(64);
    frames.push_back(std::make_shared<const EncodedFrame>(std::move(frame)));
  }
  std::size_t next = 0;
  while (state.KeepRunning()) {
    buffer.on_captured();
    buffer.push(frames[next++]);
    buffer.prepare();
    benchmark::DoNotOptimize(buffer.take());
    buffer.acknowledge(next);
    benchmark::DoNotOptimize(buffer.stats());
  }
}

/// Prints as usual and remembers the fastest repetition of each.
class FastestReporter : public benchmark::ConsoleReporter {
 public:
  FastestReporter() : ConsoleReporter(OO_Tabular) {}

  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      if (run.run_type != Run::RT_Iteration) continue;
      const std::string& name = run.run_name.function_name;
      const double us = run.GetAdjustedCPUTime();
      const auto [entry, is_new] = fastest_us_.try_emplace(name, us);
      if (!is_new) entry->second = std::min(entry->second, us);
      const auto comparisons = run.counters.find("M");
      if (comparisons != run.counters.end()) comparisons_[name] = comparisons->second;
    }
  }

  double operator[](const std::string& name) const { return fastest_us_.at(name); }
  /// M() in a push; not all of the three are new to every one.
  double comparisons(const std::string& name) const { return comparisons_.at(name); }

 private:
  std::map<std::string, double> fastest_us_;
  std::map<std::string, double> comparisons_;
};

void add(const std::string& name, void (*run)(benchmark::State&, const sim::RecordedSequence&),
         const sim::RecordedSequence& sequence, int iterations) {
  benchmark::RegisterBenchmark(name.c_str(), run, std::cref(sequence))
      ->Iterations(iterations)
      ->Repetitions(kRepetitions)
      ->Unit(benchmark::kMicrosecond);
}

SourceSettings generated(int width_px, int height_px) {
  SourceSettings source;
  source.width_px = width_px;
  source.height_px = height_px;
  source.frames = 50;
  return source;
}

SourceSettings street(const std::filesystem::path& data) {
  SourceSettings source = generated(1226, 370);
  const std::filesystem::path images = data / "kitti06_mono" / "images";
  if (std::filesystem::exists(images)) {
    source.kind = "folder";
    source.path = images;
  } else {
    fmt::print("no {}: 1226x370 is the generated scene\n", images.string());
  }
  return source;
}

void run_all(const std::filesystem::path& data) {
  const sim::RecordedSequence small("1226x370", street(data));
  const sim::RecordedSequence large("1280x1024", generated(1280, 1024));
  for (const auto* sequence : {&small, &large}) {
    add("plain_enqueue " + sequence->name(), plain_enqueue, *sequence, kPushes);
    add("enqueue " + sequence->name(), enqueue, *sequence, kPushes);
  }
  add("plain_match", plain_match, large, 50);
  add("match", match, large, 50);
  add("steady", steady, small, 1000);
  FastestReporter times;
  benchmark::RunSpecifiedBenchmarks(&times);
  for (const auto* sequence : {&small, &large}) {
    const std::string name = "enqueue " + sequence->name();
    const double worst_us = times[name] + (3 - times.comparisons(name)) * times["match"];
    fmt::print("RESULT core.enqueue_ratio.{} {:.4f}\n", sequence->name(),
               worst_us / times["plain_" + name]);
  }
  fmt::print("RESULT core.match_ratio {:.4f}\nRESULT core.steady_us {:.2f}\n",
             times["match"] / times["plain_match"], times["steady"]);
}

}  // namespace
}  // namespace orbbuf

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (argc != 2) {
    fmt::print(stderr, "usage: orbbuf-core-bench SEQUENCES_FOLDER [--benchmark_...]\n");
    return 2;
  }
  cv::setNumThreads(1);
  return orbbuf::bench::run_program("orbbuf-core-bench", [&] {
    orbbuf::bench::measure_requantising(argv[1]);
    orbbuf::run_all(argv[1]);
  });
}
