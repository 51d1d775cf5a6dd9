// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/frames.hpp"

#include <fmt/core.h>

#include <fstream>
#include <iterator>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>

#include "common/jpeg.hpp"

namespace orbbuf::evaluation {
namespace {

cv::Mat decode(std::span<const std::uint8_t> jpeg, const std::string& name) {
  thread_local JpegCodec codec;
  auto image = codec.decode_gray(jpeg, 1);
  if (!image) throw std::runtime_error(name + ": " + image.error().text);
  return cv::Mat(image.value().height_px, image.value().width_px, CV_8U,
                 image.value().pixels.data())
      .clone();
}

cv::Mat load_image(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  const std::vector<std::uint8_t> jpeg(std::istreambuf_iterator<char>(in), {});
  return decode(jpeg, file.string());
}

cv::Mat pixels_of(const orbbuf_image& image) {
  if (image.format == ORBBUF_JPEG) return decode({image.data, image.size}, "the pipe");
  const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), CV_8U,
                       const_cast<std::uint8_t*>(image.data));
  return pixels.clone();
}

}  // namespace

std::vector<ListedFrame> list_frames(const std::filesystem::path& folder) {
  std::ifstream in(folder / "times.txt");
  if (!in) throw std::runtime_error("cannot read " + (folder / "times.txt").string());
  std::vector<ListedFrame> frames;
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream fields(line);
    ListedFrame frame;
    if (line.empty() || line[0] == '#') continue;
    if (!(fields >> frame.id >> frame.time_s)) {
      throw std::runtime_error((folder / "times.txt").string() + ": cannot read \"" + line + '"');
    }
    frames.push_back(frame);
  }
  return frames;
}

GrayFrame load_frame(const std::filesystem::path& folder, const ListedFrame& frame,
                     bool with_right) {
  const auto name = fmt::format("{:06}.jpg", frame.id);
  GrayFrame loaded{frame.time_s, load_image(folder / "images" / name), {}};
  if (with_right) loaded.right = load_image(folder / "images_right" / name);
  return loaded;
}

Pipe::Pipe(std::FILE* in) { orbbuf_reader_init(&reader_, in); }

Pipe::~Pipe() { orbbuf_reader_free(&reader_); }

std::optional<PipedFrame> Pipe::next(bool is_stereo) {
  const auto left = next_image();
  if (!left) return std::nullopt;
  if (left->camera == ORBBUF_RIGHT) {
    throw std::runtime_error("the pipe has a right image without a left one");
  }
  PipedFrame frame{left->seq, {left->t, pixels_of(*left), {}}};
  if (!is_stereo) return frame;
  const auto right = next_image();
  if (!right || right->camera != ORBBUF_RIGHT) throw std::runtime_error("the pipe is not stereo");
  frame.frame.right = pixels_of(*right);
  return frame;
}

std::optional<orbbuf_image> Pipe::next_image() {
  orbbuf_image image{};
  const int got = orbbuf_read(&reader_, &image);
  if (got < 0) throw std::runtime_error(std::string("the pipe: ") + reader_.error);
  return got == 0 ? std::nullopt : std::optional(image);
}

}  // namespace orbbuf::evaluation
