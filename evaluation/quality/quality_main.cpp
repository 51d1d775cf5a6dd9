// SPDX-License-Identifier: Apache-2.0
// orbbuf-quality: what SLAM feels of JPEG quality. Requantises a sequence as orbbufd does it. For
// each quality: how many ORB features still match a view of the same place at quality 80, whether
// that place is found among the others, and, if the true path is known, the reference VO's error.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "bench/run_program.hpp"
#include "bench/sim/epipolar.hpp"
#include "bench/sim/recorded_sequence.hpp"
#include "common/command_line.hpp"
#include "common/jpeg.hpp"
#include "daemon/buffer/similarity.hpp"
#include "daemon/image/orb_extractor.hpp"
#include "daemon/image/requantiser.hpp"
#include "evaluation/odometry/reference_vo.hpp"
#include "evaluation/random.hpp"
#include "evaluation/trial/scene.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr std::array<int, 8> kQualities = {80, 50, 40, 30, 25, 20, 15, 10};
constexpr std::array<int, 3> kMixed = {30, 20, 10};  // each mixed with 80
constexpr std::uint64_t kSeeds = 3;                  // of each mixture
constexpr std::size_t kMostViews = 150;              // of a pass
constexpr int kVerified = 30;  // inliers, which no wrong place has (the column `wrong`)
constexpr double kSamePlaceS = 1;

struct Options {
  std::filesystem::path folder;
  std::filesystem::path second;
  std::size_t apart = 16;
};

std::filesystem::path name_of(const std::filesystem::path& folder) {
  return (folder / ".").lexically_normal().parent_path().filename();
}

sim::RecordedSequence load(const std::filesystem::path& folder) {
  SourceSettings source;
  source.kind = "folder";
  source.path = folder / "images";
  return {name_of(folder).string(), source};
}

/// What orbbufd would send of a frame at this quality: the frame itself if that is no smaller.
EncodedFrame at_quality(const EncodedFrame& frame, int quality) {
  thread_local Requantiser requantiser;
  auto reduced = requantiser.reduce(frame, quality);
  return reduced ? std::move(reduced).value() : frame;
}

GrayImage pixels_of(const EncodedFrame& frame) {
  thread_local JpegCodec codec;
  return codec.decode_gray(frame.left(), 1).value();
}

/// A frame as place recognition has it: a quick look, and one for the geometry.
struct View {
  explicit View(const EncodedFrame& frame) : geometry(pixels_of(frame)) {
    thread_local OrbExtractor extractor{FeatureSettings{}};
    extractor.extract(frame, features);
  }

  FeatureSet features;
  sim::EpipolarView geometry;
};

struct Score {
  double bytes = 0;    ///< of a frame, mean
  double matches = 0;  ///< with the known view of the place, mean
  double recall = 0;   ///< share of the views whose place is found first and verified
  double wrong = 0;    ///< share of the views for which another place is found and verified
  double ate_m = 0;    ///< infinite: lost
};

/// Places that a first pass has seen at quality 80, and that a second pass comes to. Without a
/// second sequence that is the first one again; then views nearer than `apart` frames are not
/// known.
class Places {
 public:
  Places(const sim::RecordedSequence& first, const sim::RecordedSequence* second, std::size_t apart)
      : second_(second ? *second : first),
        every_((first.size() + kMostViews - 1) / kMostViews),
        begin_(second ? every_ / 2 : 0),
        nearest_(second ? 0 : (apart + every_ - 1) / every_),
        farthest_(second ? static_cast<std::size_t>(kSamePlaceS * 1e9 / first.mean_interval_ns()) /
                               every_
                         : 2 * nearest_),
        known_(look(first, 0, kQualities.front())) {}

  /// The second pass at this quality. Thread-safe.
  void score(int quality, Score& score) const {
    const auto views = look(second_, begin_, quality);
    const std::size_t count = std::min(views.size(), known_.size());
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t found = find(i, views[i]);
      if (views[i].geometry.inliers(known_[found].geometry) >= kVerified) {
        ++(between(i, found) <= farthest_ ? score.recall : score.wrong);
      }
      if (i + nearest_ < count)
        score.matches += views[i].geometry.inliers(known_[i + nearest_].geometry);
    }
    score.recall /= static_cast<double>(count);
    score.wrong /= static_cast<double>(count);
    score.matches /= static_cast<double>(count - nearest_);
  }

 private:
  static std::size_t between(std::size_t i, std::size_t j) { return i < j ? j - i : i - j; }

  std::vector<View> look(const sim::RecordedSequence& sequence, std::size_t begin,
                         int quality) const {
    std::vector<View> views;
    for (std::size_t i = begin; i < sequence.size(); i += every_) {
      views.emplace_back(at_quality(*sequence.frame(i), quality));
    }
    return views;
  }

  /// The known view that is most like view i, by M.
  std::size_t find(std::size_t i, const View& view) const {
    std::size_t best = 0;
    int most = -1;
    for (std::size_t j = 0; j < known_.size(); ++j) {
      if (between(i, j) < nearest_) continue;
      const int m = similarity(view.features, known_[j].features);
      if (m > most) best = j;
      most = std::max(most, m);
    }
    return best;
  }

  const sim::RecordedSequence& second_;
  std::size_t every_;     // frames from a view to the next
  std::size_t begin_;     // the second pass is between the first one's views
  std::size_t nearest_;   // views
  std::size_t farthest_;  // views; up to there it is the same place
  std::vector<View> known_;
};

/// A quality for each frame: 80 and `low` in turns, for 0.3 to 2 s each.
std::vector<int> mixed(const sim::RecordedSequence& sequence, int low, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<int> qualities;
  double until_s = 0;
  bool is_low = true;
  for (const FramePtr& frame : sequence.frames()) {
    for (; 1e-9 * static_cast<double>(frame->capture_time_ns) >= until_s; is_low = !is_low) {
      until_s += uniform(random, 0.3, 2);
    }
    qualities.push_back(is_low ? low : kQualities.front());
  }
  return qualities;
}

/// The reference VO's ATE on the sequence with these qualities; infinite if it is lost. The folder
/// has camera.txt and truth.txt.
double odometry_ate(const sim::RecordedSequence& sequence, const std::filesystem::path& folder,
                    const std::vector<int>& qualities) {
  const Trajectory truth = read_trajectory(folder / "truth.txt");
  ReferenceVo vo(read_camera(folder / "camera.txt"));
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    const EncodedFrame& frame = *sequence.frame(i);
    GrayImage image = pixels_of(at_quality(frame, qualities[i]));
    const cv::Mat pixels(image.height_px, image.width_px, CV_8U, image.pixels.data());
    vo.track({truth.front().time_s + 1e-9 * static_cast<double>(frame.capture_time_ns),
              pixels.clone(),
              {}},
             i);
  }
  if (vo.result().is_lost()) return std::numeric_limits<double>::infinity();
  return compare(vo.result().trajectory, truth, true).ate_m;
}

Score score_at(const sim::RecordedSequence& sequence, const Places& places, const Options& options,
               bool has_truth, int quality) {
  Score score;
  for (const FramePtr& frame : sequence.frames()) {
    score.bytes += static_cast<double>(at_quality(*frame, quality).jpeg.size()) /
                   static_cast<double>(sequence.size());
  }
  places.score(quality, score);
  if (has_truth) {
    score.ate_m = odometry_ate(sequence, options.folder, std::vector(sequence.size(), quality));
  }
  return score;
}

/// The worst ATE over the seeds, for each of kMixed.
std::string try_mixed(const sim::RecordedSequence& sequence, const Options& options) {
  std::array<double, kMixed.size() * kSeeds> ates{};
  for_each_parallel("mixed", ates.size(), [&](std::size_t i) {
    const auto qualities = mixed(sequence, kMixed[i / kSeeds], 1 + i % kSeeds);
    ates[i] = odometry_ate(sequence, options.folder, qualities);
  });
  std::string results;
  for (std::size_t i = 0; i < kMixed.size(); ++i) {
    const auto begin = ates.begin() + static_cast<std::ptrdiff_t>(i * kSeeds);
    results += fmt::format("RESULT quality.{}.odometry_ate.mixed{} {:.4f}\n", sequence.name(),
                           kMixed[i], *std::max_element(begin, begin + kSeeds));
  }
  return results;
}

void run(const Options& options) {
  cv::setNumThreads(1);
  const sim::RecordedSequence sequence = load(options.folder);
  std::optional<sim::RecordedSequence> second;
  if (!options.second.empty()) second.emplace(load(options.second));
  const Places places(sequence, second ? &*second : nullptr, options.apart);
  const bool has_truth = exists(options.folder / "truth.txt");
  std::array<Score, kQualities.size()> scores;
  for_each_parallel(sequence.name(), scores.size(), [&](std::size_t i) {
    scores[i] = score_at(sequence, places, options, has_truth, kQualities[i]);
  });
  std::string results;
  fmt::print("| {} | bytes | matches | found | wrong | ATE |\n|---|---|---|---|---|---|\n",
             sequence.name());
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const Score& score = scores[i];
    const double share = score.matches / scores.front().matches;
    fmt::print("| {} | {:.0f} | {:.0f}: {:.2f} | {:.3f} | {:.3f} | {} |\n", kQualities[i],
               score.bytes, score.matches, share, score.recall, score.wrong,
               has_truth ? fmt::format("{:.4f}", score.ate_m) : "-");
    const auto result = [&](const char* what, double value) {
      results += fmt::format("RESULT quality.{}.{}.{} {:.4f}\n", sequence.name(), what,
                             kQualities[i], value);
    };
    result("match_share", share);
    result("recall_at_1", score.recall);
    if (has_truth) result("odometry_ate", score.ate_m);
  }
  if (has_truth) results += try_mixed(sequence, options);
  fmt::print("{}", results);
}

}  // namespace
}  // namespace orbbuf::evaluation

int main(int argc, char** argv) {
  orbbuf::evaluation::Options options;
  orbbuf::CommandLine app("What SLAM feels of JPEG quality");
  app.add_option("sequence", options.folder,
                 "a folder with images/; with camera.txt and truth.txt too, for the reference VO")
      .required();
  app.add_option("--second", options.second, "the folder of a second pass, with the same times");
  app.add_option("--apart", options.apart,
                 "without a second pass: frames from a view to those that it is to be known by")
      .in_range(1, 1000)
      .with_default();
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("orbbuf-quality", [&] { orbbuf::evaluation::run(options); });
}
