// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/layouts.hpp"

#include <spdlog/fmt/fmt.h>

#include <string>
#include <utility>

#include "common/decimal.hpp"
#include "server/dataset/camera_files.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

/// What all layouts need; each fills in `made`.
struct Work {
  const RecordedSession& session;
  std::string_view extension;
  Dataset made;
  int digits = 6;  ///< of images that are named by their numbers, so that their names sort

  void note(std::string text) { made.notes.push_back(std::move(text)); }
  void text(std::string to, std::string content) {
    made.texts.push_back({std::move(to), std::move(content)});
  }
  void image(std::string from, const std::string& folder, const std::string& stem) {
    made.images.push_back({std::move(from), fmt::format("{}/{}.{}", folder, stem, extension)});
  }
};

void lay_out_tum_mono(Work& work) {
  std::string times;
  std::string checksums;
  std::string qualities;
  const auto add = [&](const std::string& from, const char* folder, Sequence sequence) {
    work.image(from, folder, fmt::format("{:0{}}", sequence, work.digits));
    const auto checksum = work.session.checksums.find(from);
    if (checksum == work.session.checksums.end()) return;
    checksums += session_lines::checksum(work.made.images.back().to, checksum->second) + '\n';
  };
  for (const RecordedFrame& frame : work.session.frames) {
    add(left_image(frame), session_names::kImages, frame.sequence);
    if (work.session.is_stereo) {
      add(right_image(frame), session_names::kRightImages, frame.sequence);
    }
    times +=
        session_lines::to_text({frame.sequence, frame.capture_time_ns, frame.exposure_ms}) + '\n';
    qualities += quality_line(work.session, frame.sequence);
  }
  std::string drops = std::string(kDropCsvHeader) + '\n';
  for (const DropRecord& drop : work.session.drops) drops += to_csv(drop) + '\n';
  if (!work.session.drops.empty()) work.text(session_names::kDrops, std::move(drops));
  if (!checksums.empty()) work.text(session_names::kChecksums, std::move(checksums));
  if (!qualities.empty()) {
    work.text(session_names::kQualities,
              fmt::format("{}\n{}", session_lines::kQualityHeader, qualities));
  }
  if (!work.session.calibration.empty()) {
    work.text(session_names::kCamera, work.session.calibration);
  }
  work.text(session_names::kTimes, std::move(times));
}

void lay_out_euroc(Work& work) {
  std::string index = "#timestamp [ns],filename\n";
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = std::to_string(frame.capture_time_ns);
    work.image(left_image(frame), "mav0/cam0/data", stem);
    if (work.session.is_stereo) {
      work.image(right_image(frame), "mav0/cam1/data", stem);
    }
    index += fmt::format("{},{}.{}\n", frame.capture_time_ns, stem, work.extension);
  }
  work.text("mav0/cam0/data.csv", index);
  if (work.session.is_stereo) work.text("mav0/cam1/data.csv", std::move(index));
  add_euroc_camera(work.session, work.made);
}

void lay_out_kitti(Work& work) {
  std::string times;
  std::size_t number = 0;
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = fmt::format("{:0{}}", number++, work.digits);
    work.image(left_image(frame), "image_0", stem);
    if (work.session.is_stereo) {
      work.image(right_image(frame), "image_1", stem);
    }
    times += format_seconds(frame.capture_time_ns) + '\n';
  }
  work.text("times.txt", std::move(times));
  add_kitti_camera(work.session, work.made);
}

void lay_out_tum_rgbd(Work& work) {
  std::string index = "# color images\n# by orbbuf-server export\n# timestamp filename\n";
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = format_seconds(frame.capture_time_ns);
    work.image(left_image(frame), "rgb", stem);
    index += fmt::format("{} {}\n", stem, work.made.images.back().to);
  }
  work.text("rgb.txt", std::move(index));
  if (work.session.is_stereo) work.note("TUM RGB-D has one camera: the right images are left out");
  if (work.session.calibration.empty()) return;
  work.note("TUM RGB-D has no file for a calibration: camera.txt is left out");
}

}  // namespace

Dataset lay_out(const RecordedSession& session, Layout layout, std::string_view extension) {
  Work work{session, extension, {}};
  constexpr Sequence kMostOfSixDigits = 999'999;
  if (!session.frames.empty() && session.frames.back().sequence > kMostOfSixDigits) work.digits = 9;
  if (session.calibration.empty()) work.note("no calibration: the robot sent none");
  switch (layout) {
    case Layout::kTumMono:
      lay_out_tum_mono(work);
      break;
    case Layout::kEuroc:
      lay_out_euroc(work);
      break;
    case Layout::kKitti:
      lay_out_kitti(work);
      break;
    case Layout::kTumRgbd:
      lay_out_tum_rgbd(work);
      break;
  }
  return std::move(work.made);
}

}  // namespace orbbuf
