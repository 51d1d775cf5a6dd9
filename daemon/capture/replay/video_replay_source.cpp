// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/video_replay_source.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "common/log.hpp"
#include "daemon/capture/replay/replay_frame.hpp"

namespace orbbuf {
namespace {

/// Reads that fail in succession until the video is taken to be at its end: FFmpeg reports a frame
/// that cannot be decoded as it does the end.
constexpr int kMaxFailedReads = 1000;

/// Containers state how long they are less exactly than this, for example if sound goes on.
constexpr double kSlackSeconds = 0.25;

/// So many frames at the stated rate, to a part of the time between two frames, show that the file
/// has a steady one.
constexpr std::int64_t kSteadyFrames = 8;
constexpr double kSteadyTolerance = 0.2;

}  // namespace

VideoReplaySource::VideoReplaySource(const SourceSettings& settings)
    : path_(settings.path), is_color_(settings.color), fps_(settings.fps) {
  if (path_.empty()) throw std::runtime_error("cannot replay a video: source.path is not set");
  const auto attempt = "cannot replay video " + path_.string();
  // Asked first, since cv::VideoCapture takes much else for a video: numbers, patterns, addresses.
  std::error_code error;
  const auto status = std::filesystem::status(path_, error);
  if (!exists(status)) throw std::runtime_error(attempt + ": " + error.message());
  if (!is_regular_file(status)) throw std::runtime_error(attempt + ": not a regular file");
  // Not OpenCV's other backends: they would go on to look for devices and leak in doing so.
  if (!video_.open(path_.string(), cv::CAP_FFMPEG) &&
      !video_.open(path_.string(), cv::CAP_OPENCV_MJPEG)) {
    throw std::runtime_error(attempt + ": neither FFmpeg nor OpenCV recognises it as a video");
  }
  const double stated_fps = video_.get(cv::CAP_PROP_FPS);
  if (is_usable_fps(stated_fps)) fps_ = stated_fps;
  stated_seconds_ = video_.get(cv::CAP_PROP_FRAME_COUNT) / fps_;
  decode_next();
  read_no_fields();
  if (decoded_.empty()) throw std::runtime_error(attempt + ": the video has no frames");
}

/// If a Motion JPEG states a height of which its images have less than 3/4, FFmpeg takes two of
/// them for the fields of one frame, and fails at each other one. OpenCV's own reader does not.
void VideoReplaySource::read_no_fields() {
  cv::Mat first;
  const bool is_readable = missing_ > 0 &&
                           cv::VideoCapture(path_.string(), cv::CAP_OPENCV_MJPEG).read(first) &&
                           first.rows != decoded_.rows;
  if (!is_readable || !video_.open(path_.string(), cv::CAP_OPENCV_MJPEG)) return;
  log_warn("video {}: its images are not as high as it states: {} pixels", path_.string(),
           first.rows);
  decoded_count_ = 0;
  decode_next();
}

void VideoReplaySource::decode_next() {
  missing_ = 0;
  try {
    decoded_ = cv::Mat();  // the one before may still be lent
    while (!video_.read(decoded_) && missing_ < kMaxFailedReads) ++missing_;
  } catch (const cv::Exception& error) {
    throw std::runtime_error("cannot continue reading video " + path_.string() + ": " + error.err);
  }
  if (decoded_.empty()) {
    missing_ = missing_at_end();
  } else {
    note_position();
    ++decoded_count_;
  }
}

void VideoReplaySource::note_position() {
  const double nominal = static_cast<double>(index_ + missing_) / fps_;
  const double stated = video_.get(cv::CAP_PROP_POS_MSEC) / 1e3;
  position_seconds_ = stated > 0 ? stated : nominal;  // some containers have no times
  const double place = position_seconds_ * fps_;
  const auto nearest = std::llround(place);
  if (is_steady() && nearest > index_) missing_ = nearest - index_;
  const bool agrees = std::abs(place - static_cast<double>(nearest)) < kSteadyTolerance &&
                      nearest == index_ + missing_;
  has_steady_rate_ = has_steady_rate_ && agrees;
}

std::int64_t VideoReplaySource::missing_at_end() {
  const double missing_seconds = stated_seconds_ - position_seconds_ - 1 / fps_;
  breaks_off_ = missing_seconds > kSlackSeconds;
  if (breaks_off_) return 1;
  return is_steady() ? std::max(std::llround(missing_seconds * fps_), 0LL) : 0;
}

bool VideoReplaySource::is_steady() const {
  return has_steady_rate_ && decoded_count_ >= kSteadyFrames;
}

RawFrame VideoReplaySource::missing_frame() {
  RawFrame frame;
  frame.capture_time_ns = nominal_time_ns(index_++, fps_);
  frame.defect = fmt::format("cannot read the frame at {:.3f} s of {}",
                             static_cast<double>(frame.capture_time_ns) / 1e9, path_.string());
  return frame;
}

std::optional<RawFrame> VideoReplaySource::next(std::stop_token stop) {
  if (stop.stop_requested()) return std::nullopt;
  if (missing_ > 0) {
    --missing_;
    return missing_frame();
  }
  if (decoded_.empty() && !breaks_off_) return std::nullopt;
  if (decoded_.empty()) {
    throw std::runtime_error(fmt::format(
        "video {} breaks off at {:.2f} s of the {:.2f} s that it states: {} frames were read",
        path_.string(), position_seconds_, stated_seconds_, decoded_count_));
  }
  const auto time_ns = nominal_time_ns(index_++, fps_);
  cv::Mat image = decoded_;
  if (image.type() == CV_8UC3 && !is_color_) {
    cv::cvtColor(decoded_, image, cv::COLOR_BGR2GRAY);
  }
  const bool is_usable = image.type() == CV_8UC1 || image.type() == CV_8UC3;
  RawFrame frame;
  if (is_usable) {
    frame = replay_frame(std::move(image), time_ns);
  } else {
    frame.capture_time_ns = time_ns;
    frame.defect =
        "cannot use " + path_.string() + ": its pixels are neither 8-bit gray nor 8-bit colour";
  }
  decode_next();
  return frame;
}

std::string VideoReplaySource::description() const {
  return fmt::format("video {}: {:.4g} fps", path_.string(), fps_);
}

}  // namespace orbbuf
