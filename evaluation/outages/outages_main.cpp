// SPDX-License-Identifier: Apache-2.0
// orbbuf-outages: lists of the frames that arrive through outages, and what a SLAM program made of
// them.
//   make SEQUENCE OUT       writes OUT/SEQUENCE/LINK/LENGTHs-LATENESSs/PLACE/POLICY.csv
//   folder LIST SEQUENCE OUT
//                           makes the folder of a list: images/ and times.txt, as the server would
//                           have them
//   judge LISTS RUNS        compares RUNS/.../POLICY.txt (TUM) with the truth, for all lists
// README.md has the format and the figures.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "bench/run_program.hpp"
#include "bench/sim/trial.hpp"
#include "common/progress.hpp"
#include "daemon/capture/make_source.hpp"
#include "daemon/image/jpeg_encoder.hpp"
#include "daemon/image/requantiser.hpp"
#include "evaluation/outages/judge.hpp"
#include "evaluation/outages/list_maker.hpp"
#include "evaluation/outages/truth.hpp"

namespace orbbuf::evaluation {
namespace {

namespace fs = std::filesystem;

struct MakeOptions {
  fs::path sequence;
  fs::path out;
  fs::path traces = "../shared/data/traces";
  fs::path truth;
  std::vector<std::string> links = {"constant:1.5", "constant:2.5",
                                    "mahimahi/ATT-LTE-driving-2016.up:2",
                                    "ghent/report_bus_0001.json:2"};
  std::vector<std::string> policies = ListMaker::policies();
  std::vector<double> lengths_s = {1, 2, 3, 5, 10};
  std::vector<double> lateness_s = {1};
  std::size_t places = 12;
  double lead_s = 3;
  double tail_s = 3;
  double fps = 0;
};

std::string name_of(const fs::path& folder) {
  return (folder / ".").lexically_normal().parent_path().filename().string();
}

SourceSettings source_of(const fs::path& sequence, double fps) {
  SourceSettings source;
  source.kind = "folder";
  source.path = sequence / "images";
  if (fps > 0) source.fps = fps;
  source.realtime = false;
  return source;
}

std::vector<Link> read_links(const MakeOptions& options) {
  std::vector<Link> links;
  for (const std::string& text : options.links) {
    try {
      links.push_back(read_link(text, options.traces));
    } catch (const std::runtime_error& error) {
      fmt::print(stderr, "orbbuf-outages: skipped: {}\n", error.what());
    }
  }
  if (links.empty()) throw std::runtime_error("no link");
  return links;
}

/// The poses of the list's frames at their times in what is played.
void write_truth(const fs::path& file, const OutageList& unbroken,
                 const std::vector<std::string>& images,
                 const std::vector<std::optional<Eigen::Isometry3d>>& poses) {
  Trajectory played;
  for (const ListedArrival& arrival : unbroken.arrivals) {
    const auto at = std::ranges::lower_bound(images, arrival.image) - images.begin();
    const auto& pose = poses[static_cast<std::size_t>(at)];
    if (pose) played.push_back({arrival.capture_s, *pose});
  }
  write_trajectory(file, played);
}

/// Of each frame, by the sequence's own clock.
std::vector<std::optional<Eigen::Isometry3d>> read_truth(const MakeOptions& options,
                                                         const sim::RecordedSequence& sequence) {
  if (options.truth.empty()) return {};
  const auto first = make_source(source_of(options.sequence, options.fps))->next({});
  std::vector<double> times_s;
  for (const FramePtr& frame : sequence.frames()) {
    times_s.push_back(1e-9 * static_cast<double>(first->capture_time_ns + frame->capture_time_ns));
  }
  return truth_of_frames(options.truth, times_s);
}

void make(const MakeOptions& options) {
  const auto files = images_of(options.sequence);
  std::vector<std::string> images;
  images.reserve(files.size());
  for (const auto& file : files) images.push_back(file.filename().string());
  const std::vector<Link> links = read_links(options);
  sim::RecordedSequence sequence(name_of(options.sequence),
                                 source_of(options.sequence, options.fps));
  const double sequence_s = 1e-9 * static_cast<double>(sequence.frames().back()->capture_time_ns);
  const auto truth = read_truth(options, sequence);
  const std::string sha256 = sha256_of(files);
  Progress progress("outages", "lists",
                    links.size() * options.lengths_s.size() * options.lateness_s.size() *
                        options.places * options.policies.size());
  for (const double length_s : options.lengths_s) {
    for (const double lateness_s : options.lateness_s) {
      OutagePlan plan{0, length_s, lateness_s, options.lead_s, options.tail_s};
      const Places places = place_outages(sequence_s, length_s, options.places, plan.lead_s,
                                          lateness_s + plan.tail_s);
      ListMaker maker(sequence, images, sha256, places.played_s);
      for (const Link& link : links) {
        for (std::size_t place = 0; place < places.begin_s.size(); ++place) {
          plan.begin_s = places.begin_s[place];
          plan.seed = place + 1;
          const auto folder = options.out / sequence.name() / link.name /
                              fmt::format("{:g}s-{:g}s", length_s, lateness_s) /
                              fmt::format("{:02}", place);
          fs::create_directories(folder);
          for (const OutageList& list : maker.make(options.policies, link, plan)) {
            write_list(folder / (list.policy + ".csv"), list);
            progress.add();
          }
          if (!truth.empty()) {
            write_truth(folder / "truth.txt", maker.make({"unbroken"}, link, plan).front(), images,
                        truth);
          }
        }
      }
    }
  }
}

struct FolderOptions {
  fs::path list;
  fs::path sequence;
  fs::path out;
  double fps = 0;
};

void write_file(const fs::path& file, std::span<const std::uint8_t> bytes) {
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

/// The list's frames of the sequence as orbbufd encodes them, by the name of the image; of a stereo
/// sequence both images.
std::map<std::string, EncodedFrame> encode(const OutageList& list, const FolderOptions& options,
                                           const std::vector<fs::path>& files) {
  std::set<std::string> wanted;
  for (const ListedArrival& arrival : list.arrivals) wanted.insert(arrival.image);
  SourceSettings settings = source_of(options.sequence, options.fps);
  if (exists(options.sequence / "images_right"))
    settings.path_right = options.sequence / "images_right";
  const auto source = make_source(settings);
  JpegEncoder encoder(JpegSettings{});
  std::map<std::string, EncodedFrame> frames;
  for (const auto& file : files) {
    const auto raw = source->next({});
    if (!raw) throw std::runtime_error("the source ends before " + file.string());
    if (!wanted.contains(file.filename().string())) continue;
    auto encoded = encoder.encode(*raw, frames.size());
    if (!encoded) throw std::runtime_error(file.string() + ": " + encoded.error().text);
    frames.emplace(file.filename().string(), std::move(encoded.value()));
  }
  return frames;
}

void make_folder(const FolderOptions& options) {
  const OutageList list = read_list(options.list);
  const auto files = images_of(options.sequence);
  if (sha256_of(files) != list.sha256) {
    throw std::runtime_error(
        fmt::format("{} is not the sequence of {}: its images have another checksum",
                    options.sequence.string(), options.list.string()));
  }
  const auto frames = encode(list, options, files);
  Requantiser requantiser;
  fs::create_directories(options.out / "images");
  std::ofstream times(options.out / "times.txt");
  std::ofstream arrivals(options.out / "arrivals.txt");
  for (const ListedArrival& arrival : list.arrivals) {
    const EncodedFrame& whole = frames.at(arrival.image);
    auto reduced = arrival.quality > 0 && arrival.quality < sim::kQuality
                       ? requantiser.reduce(whole, arrival.quality)
                       : Error{};
    const EncodedFrame& frame = reduced ? reduced.value() : whole;
    const std::string name = fmt::format("{:06}.jpg", arrival.number);
    write_file(options.out / "images" / name, frame.left());
    if (frame.is_stereo()) {
      fs::create_directories(options.out / "images_right");
      write_file(options.out / "images_right" / name, frame.right());
    }
    times << fmt::format("{} {:.9f} 0.000000\n", arrival.number, arrival.capture_s);
    arrivals << fmt::format("{} {:.6f}\n", arrival.number, arrival.arrival_s);
  }
  if (!times.flush() || !arrivals.flush())
    throw std::runtime_error("cannot write " + options.out.string());
}

struct JudgeOptions {
  fs::path lists;
  fs::path runs;
  std::string reference = "uniform";
  Criteria criteria;
};

Trajectory read_if_any(const fs::path& file) {
  return exists(file) ? read_trajectory(file) : Trajectory{};
}

/// LISTS/SEQUENCE/LINK/LENGTH-LATENESS/PLACE/POLICY.csv, and RUNS/... .txt.
void judge_all(const JudgeOptions& options) {
  std::map<std::string, std::map<std::string, Survived>>
      groups;  // by conditions, by policy, by place
  fmt::print(
      "list,survived,tracked,relocalised,ate,rpe,rpe_deg,turn_deg,unbroken_ate,unbroken_turn_deg,"
      "poses\n");
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(options.lists)) {
    if (entry.path().extension() == ".csv" && entry.path().stem() != "unbroken")
      files.push_back(entry.path());
  }
  std::ranges::sort(files);
  for (const auto& file : files) {
    const auto place = fs::relative(file.parent_path(), options.lists);
    const auto run = options.runs / place;
    const std::string policy = file.stem().string();
    if (!exists(run / "unbroken.txt")) continue;  // not run
    const OutageList list = read_list(file);
    const Trajectory unbroken = read_trajectory(run / "unbroken.txt");
    const Trajectory truth = read_if_any(file.parent_path() / "truth.txt");
    const Judgement j = judge(list, read_if_any(run / (policy + ".txt")), unbroken,
                              truth.empty() ? unbroken : truth, options.criteria);
    fmt::print("{}/{},{:d},{:d},{:d},{:.4f},{:.4f},{:.3f},{:.2f},{:.4f},{:.2f},{}\n",
               place.string(), policy, j.is_survived, j.is_tracked, j.is_relocalised, j.error.ate_m,
               j.error.rpe_m, j.error.rpe_deg, j.turn_deg, j.unbroken_ate_m, j.unbroken_turn_deg,
               j.error.poses);
    groups[place.parent_path().string()][policy][place.filename().string()] = j.is_survived;
    groups["all"][policy][place.string()] = j.is_survived;
  }
  for (const auto& [conditions, policies] : groups) {
    for (const auto& [policy, survived] : policies) {
      const Share share = share_of(survived);
      const auto [low, high] = share.interval();
      fmt::print("RESULT outages.{}.{}.survived {}/{} {:.4f} {:.4f} {:.4f}\n", conditions, policy,
                 share.some, share.all, share.value(), low, high);
      const auto reference = policies.find(options.reference);
      if (reference == policies.end() || policy == options.reference) continue;
      const Paired paired = compare_places(survived, reference->second);
      fmt::print("RESULT outages.{}.{}.against_{} {} {} {} {} {:.4f}\n", conditions, policy,
                 options.reference, paired.both, paired.only_first, paired.only_second,
                 paired.neither, paired.p_value());
    }
  }
}

int run(int argc, char** argv) {
  CLI::App app("Lists of the frames that arrive through outages, and what SLAM made of them");
  app.require_subcommand(1);
  MakeOptions making;
  auto* make_app = app.add_subcommand("make", "write the lists of a sequence");
  make_app->add_option("SEQUENCE", making.sequence, "folder with images/ and times.txt")
      ->required();
  make_app->add_option("OUT", making.out)->required();
  make_app->add_option("--links", making.links,
                       "constant:RATE or TRACE:RATE, in multiples of the need");
  make_app->add_option("--traces", making.traces, "folder of the traces");
  make_app->add_option("--truth", making.truth,
                       "TUM's or KITTI's form, by the sequence's times or frames");
  make_app->add_option("--policies", making.policies);
  make_app->add_option("--outages", making.lengths_s, "seconds");
  make_app->add_option("--lateness", making.lateness_s, "seconds until the stream is live again");
  make_app->add_option("--places", making.places)->check(CLI::PositiveNumber);
  make_app->add_option("--lead", making.lead_s, "seconds of each list before the outage");
  make_app->add_option("--tail", making.tail_s, "seconds after the stream is live again");
  make_app->add_option("--fps", making.fps, "of a sequence without times.txt");
  FolderOptions folder;
  auto* folder_app = app.add_subcommand("folder", "make the folder of a list");
  folder_app->add_option("LIST", folder.list)->required();
  folder_app->add_option("SEQUENCE", folder.sequence)->required();
  folder_app->add_option("OUT", folder.out)->required();
  folder_app->add_option("--fps", folder.fps, "of a sequence without times.txt");
  JudgeOptions judging;
  auto* judge_app = app.add_subcommand("judge", "compare trajectories with the truth");
  judge_app->add_option("LISTS", judging.lists)->required();
  judge_app->add_option("RUNS", judging.runs, "POLICY.txt (TUM) where LISTS has POLICY.csv")
      ->required();
  judge_app->add_option("--reference", judging.reference, "the policy that all are compared with");
  judge_app->add_option("--ate-ratio", judging.criteria.ate_ratio);
  judge_app->add_option("--ate-floor", judging.criteria.ate_floor,
                        "of lists without a truth, whose unbroken run is the truth");
  judge_app->add_option("--turn", judging.criteria.turn_deg, "degrees");
  judge_app->add_flag("!--metric", judging.criteria.is_mono,
                      "the scale is known: stereo, or with an IMU");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error);
  }
  if (make_app->parsed()) make(making);
  if (folder_app->parsed()) make_folder(folder);
  if (judge_app->parsed()) judge_all(judging);
  return EXIT_SUCCESS;
}

}  // namespace
}  // namespace orbbuf::evaluation

int main(int argc, char** argv) {
  return orbbuf::bench::run_program("orbbuf-outages",
                                    [&] { return orbbuf::evaluation::run(argc, argv); });
}
