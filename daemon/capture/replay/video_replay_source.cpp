// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/video_replay_source.hpp"

#include <spdlog/fmt/fmt.h>

#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "daemon/capture/replay/replay_frame.hpp"

namespace orbbuf {

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
  decode_next();
  if (decoded_.empty()) throw std::runtime_error(attempt + ": the video has no frames");
  const double stated_fps = video_.get(cv::CAP_PROP_FPS);
  if (is_usable_fps(stated_fps)) fps_ = stated_fps;
}

void VideoReplaySource::decode_next() {
  try {
    decoded_ = cv::Mat();  // the one before may still be lent
    video_.read(decoded_);
  } catch (const cv::Exception& error) {
    throw std::runtime_error("cannot continue reading video " + path_.string() + ": " + error.err);
  }
}

std::optional<RawFrame> VideoReplaySource::next(std::stop_token stop) {
  if (decoded_.empty() || stop.stop_requested()) return std::nullopt;
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
