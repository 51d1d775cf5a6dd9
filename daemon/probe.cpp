// SPDX-License-Identifier: Apache-2.0
#include "daemon/probe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <list>
#include <map>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/capture/make_source.hpp"
#include "daemon/image/image_shift.hpp"
#include "daemon/samples/sample_probe.hpp"
#include "daemon/samples/time_shift.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr auto kCaptureTime = 2s;
constexpr auto kTimeOfMotion = 6s;  // with samples
constexpr auto kPatience = 7s;
constexpr std::size_t kTimed = 8;  // of the last frames

struct Footage {
  std::int64_t first_ns = 0;
  std::int64_t last_ns = 0;
  int frames = 0;
  int defects = 0;
  std::deque<RawFrame> last;  // without a defect
  std::vector<ImageMotion> motions{};
  std::chrono::seconds patience{0};  // how long it was waited for
};

double ms_since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

/// With the motion of the images it takes longer.
Footage capture(FrameSource& source, const JpegSettings& jpeg, bool with_motion) {
  const auto time = with_motion ? kTimeOfMotion : kCaptureTime;
  JpegEncoder encoder(jpeg);
  ImageShift shift;
  std::stop_source stop;
  std::mutex mutex;
  std::condition_variable_any ended;
  Footage footage;
  footage.patience = time + kPatience - kCaptureTime;
  const std::jthread alarm([&](const std::stop_token& is_captured) {
    std::unique_lock lock(mutex);
    ended.wait_for(lock, is_captured, footage.patience, [] { return false; });
    stop.request_stop();
  });
  Clock::time_point first;
  while (auto frame = source.next(stop.get_token())) {
    if (footage.frames++ == 0) {
      first = Clock::now();
      footage.first_ns = frame->capture_time_ns;
    }
    const std::int64_t before_ns = std::exchange(footage.last_ns, frame->capture_time_ns);
    if (with_motion) {
      const auto coded = encoder.encode(*frame, 0);
      const auto pixels =
          coded ? shift.add(coded.value().jpeg, coded.value().width_px) : shift.add({}, 0);
      if (pixels) footage.motions.push_back({before_ns, footage.last_ns, *pixels});
    }
    if (frame->defect.empty()) {
      footage.last.push_back(std::move(*frame));
    } else {
      ++footage.defects;
    }
    if (footage.last.size() > kTimed) footage.last.pop_front();
    if (Clock::now() - first >= time) break;
  }
  return footage;
}

/// Adds up what a frame costs in `result`; in the first one caches are cold, so it does not count.
void time_frames(const Settings& settings, const std::deque<RawFrame>& frames,
                 ProbeResult& result) {
  JpegEncoder encoder(settings.jpeg);
  OrbExtractor extractor(settings.features);
  FeatureSet features;
  int timed = -1;
  for (const RawFrame& raw : frames) {
    auto start = Clock::now();
    const auto frame = encoder.encode(raw, 0);
    const double encode_ms = ms_since(start);
    if (!frame) throw std::runtime_error(frame.error().text);
    start = Clock::now();
    extractor.extract(frame.value(), features);
    const double features_ms = ms_since(start);
    result.width_px = frame.value().width_px;
    result.height_px = frame.value().height_px;
    if (++timed == 0) continue;
    result.encode_ms += (encode_ms - result.encode_ms) / timed;
    result.features_ms += (features_ms - result.features_ms) / timed;
    result.jpeg_bytes +=
        (static_cast<double>(frame.value().jpeg.size()) - result.jpeg_bytes) / timed;
  }
}

std::string in_toml(const std::string& text) {
  std::string quoted = "\"";
  for (const char letter : text) {
    const auto code = static_cast<unsigned char>(letter);
    if (code < 0x20 || code == 0x7F) {
      quoted += fmt::format("\\u{:04X}", code);
      continue;
    }
    if (letter == '"' || letter == '\\') quoted += '\\';
    quoted += letter;
  }
  return quoted + '"';
}

/// Their names are bare keys: a camera has none that is not.
std::string in_toml(const std::map<std::string, double>& controls) {
  std::vector<std::string> entries(controls.size());
  std::ranges::transform(controls, entries.begin(), [](const auto& control) {
    return fmt::format("{} = {}", control.first, control.second);
  });
  return fmt::format("{{ {} }}", fmt::join(entries, ", "));
}

/// A line, if the samples came beside the frames.
std::string shift_of(const Footage& footage, const SampleProbe& stream) {
  constexpr double kTogether = 0.8;
  const auto shift = find_time_shift(footage.motions, stream.samples());
  if (shift && shift->correlation >= kTogether) {
    return fmt::format(
        "  its time is the camera's {:+.3f} s (timeshift_cam_imu), by the motion of the images; "
        "correlation {:.2f}\n",
        shift->seconds, shift->correlation);
  }
  if (stream.samples().empty()) return {};
  return "  for the time between its clock and the camera's, turn the camera to and fro "
         "meanwhile\n";
}

}  // namespace

std::string probe(const Settings& settings) {
  const auto source = make_source(settings.source);
  const auto description = source->description();
  std::list<SampleProbe> streams;
  for (const SampleStreamSettings& stream : settings.streams) streams.emplace_back(stream);
  const Footage footage = capture(*source, settings.jpeg, !streams.empty());
  if (footage.last.size() < 2 || footage.last_ns <= footage.first_ns) {
    throw std::runtime_error(fmt::format("{}: fewer than two usable frames within {} s",
                                         description, footage.patience.count()));
  }
  ProbeResult result;
  result.fps = (footage.frames - 1) * 1e9 / static_cast<double>(footage.last_ns - footage.first_ns);
  time_frames(settings, footage.last, result);
  const auto features =
      OrbExtractor::is_built()
          ? fmt::format("ORB features, only while frames wait: {:.2f} ms a frame\n",
                        result.features_ms)
          : std::string();
  std::string samples;
  for (SampleProbe& stream : streams) {
    stream.end(footage.first_ns, footage.last_ns);
    samples += stream.report() + shift_of(footage, stream);
  }
  return fmt::format(
      "source: {}\n"
      "captured: {} frames, {} of them defective, at {:.4g} fps, {}x{} px\n"
      "JPEG: {:.2f} ms and {:.1f} kB a frame, {:.2f} Mbit/s on the link\n"
      "{}{}"
      "suggested:\n{}",
      description, footage.frames, footage.defects, result.fps, result.width_px, result.height_px,
      result.encode_ms, result.jpeg_bytes / 1000, result.jpeg_bytes * 8e-6 * result.fps, features,
      samples, suggest(settings, result));
}

std::string suggest(const Settings& settings, const ProbeResult& result) {
  constexpr int kLeastPixels = 10'000;  // what settings.cpp allows
  const double share = result.features_ms * result.fps / 1000;
  int pixels = std::min(settings.features.pixels, result.width_px * result.height_px);
  pixels = share > 0.5 ? std::max(static_cast<int>(pixels * 0.5 / share), kLeastPixels)
                       : settings.features.pixels;
  const SourceSettings& source = settings.source;
  std::string text = fmt::format("[source]\nkind = \"{}\"\n", source.kind);
  if (source.kind == "v4l2") {
    text += fmt::format("device = {}\nformat = \"{}\"\n", in_toml(source.device), source.format);
  } else if (source.kind == "libcamera") {
    text += fmt::format("camera = {}\nformat = \"{}\"\n", in_toml(source.camera), source.format);
  }
  if (!source.topic.empty()) text += fmt::format("topic = {}\n", in_toml(source.topic));
  if (!source.topic_right.empty()) {
    text += fmt::format("topic_right = {}\n", in_toml(source.topic_right));
  }
  if (!source.path.empty()) text += fmt::format("path = {}\n", in_toml(source.path.string()));
  if (!source.path_right.empty()) {
    text += fmt::format("path_right = {}\n", in_toml(source.path_right.string()));
  }
  if (!source.device_right.empty()) {
    text += fmt::format("device_right = {}\n", in_toml(source.device_right));
  }
  if (!source.controls.empty()) {
    text += fmt::format("controls = {}\n", in_toml(source.controls));
  }
  if (source.crop) text += fmt::format("crop = \"{}\"\n", to_string(*source.crop));
  if (source.is_side_by_side) text += "stereo = \"side-by-side\"\n";
  return text + fmt::format(
                    "width = {}\nheight = {}\nfps = {:.4g}\n[jpeg]\nquality = {}\ncolor = "
                    "{}\n[features]\npixels = {}\n",
                    source.is_side_by_side ? 2 * result.width_px : result.width_px,
                    result.height_px, result.fps, settings.jpeg.quality, settings.jpeg.color,
                    pixels);
}

}  // namespace orbbuf
