// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/layouts.hpp"

#include <fmt/core.h>

#include <string>
#include <utility>

#include "common/decimal.hpp"
#include "server/dataset/camera_files.hpp"
#include "server/session/session_lines.hpp"
#include "server/session/session_names.hpp"

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
  /// Without a folder `right` the right image is left out.
  void images(const RecordedFrame& frame, const char* left, const char* right,
              const std::string& stem) {
    const auto add = [&](std::string from, const char* folder) {
      made.images.push_back({std::move(from), fmt::format("{}/{}.{}", folder, stem, extension)});
    };
    add(session_names::left_image(frame.sequence), left);
    if (right != nullptr && frame.is_stereo()) {
      add(session_names::right_image(frame.sequence), right);
    }
  }
  const std::string& calibration() const { return session.summary.info.calibration; }
};

void lay_out_tum_mono(Work& work) {
  std::string times;
  std::string checksums;
  std::string qualities;
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = fmt::format("{:0{}}", frame.sequence, work.digits);
    const std::size_t first = work.made.images.size();
    work.images(frame, session_names::kImages, session_names::kRightImages, stem);
    for (std::size_t i = first; i < work.made.images.size(); ++i) {
      checksums += fmt::format("{} {:08X}\n", work.made.images[i].to,
                               i == first ? frame.crc : frame.crc_right);
    }
    times += session_lines::times(frame);
    qualities += session_lines::quality(frame);
  }
  std::string drops;
  for (const DropRecord& drop : work.session.drops) drops += to_csv(drop);
  if (!drops.empty())
    work.text(session_names::kDrops, fmt::format("{}\n{}", kDropCsvHeader, drops));
  if (!checksums.empty()) work.text(session_names::kChecksums, std::move(checksums));
  if (!qualities.empty()) {
    work.text(session_names::kQualities, std::string(session_lines::kQualityHeader) + qualities);
  }
  if (!work.calibration().empty()) work.text(session_names::kCamera, work.calibration());
  work.text(session_names::kTimes, std::move(times));
}

void lay_out_euroc(Work& work) {
  std::string index = "#timestamp [ns],filename\n";
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = std::to_string(frame.capture_time_ns);
    work.images(frame, "mav0/cam0/data", "mav0/cam1/data", stem);
    index += fmt::format("{},{}.{}\n", frame.capture_time_ns, stem, work.extension);
  }
  work.text("mav0/cam0/data.csv", index);
  if (is_stereo(work.session)) work.text("mav0/cam1/data.csv", std::move(index));
  add_euroc_camera(work.session, work.made);
}

void lay_out_kitti(Work& work) {
  std::string times;
  std::size_t number = 0;
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = fmt::format("{:0{}}", number++, work.digits);
    work.images(frame, "image_0", "image_1", stem);
    times += format_seconds(frame.capture_time_ns) + '\n';
  }
  work.text("times.txt", std::move(times));
  add_kitti_camera(work.session, work.made);
}

void lay_out_tum_rgbd(Work& work) {
  std::string index = "# color images\n# by orbbuf-server export\n# timestamp filename\n";
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = format_seconds(frame.capture_time_ns);
    work.images(frame, "rgb", nullptr, stem);
    index += fmt::format("{} {}\n", stem, work.made.images.back().to);
  }
  work.text("rgb.txt", std::move(index));
  if (is_stereo(work.session)) work.note("TUM RGB-D has one camera: the right images are left out");
  if (work.calibration().empty()) return;
  work.note("TUM RGB-D has no file for a calibration: camera.txt is left out");
}

}  // namespace

Dataset lay_out(const RecordedSession& session, Layout layout, std::string_view extension) {
  Work work{session, extension, {}};
  constexpr Sequence kMostOfSixDigits = 999'999;
  if (!session.frames.empty() && session.frames.back().sequence > kMostOfSixDigits) work.digits = 9;
  if (work.calibration().empty()) work.note("no calibration: the robot sent none");
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
    case Layout::kMcap:
      break;
  }
  return std::move(work.made);
}

}  // namespace orbbuf
