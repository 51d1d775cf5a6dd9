// SPDX-License-Identifier: Apache-2.0
#include "bench/paper/judge/frames.hpp"

#include <spdlog/fmt/fmt.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>
#include <string>

#include "common/jpeg.hpp"

namespace orbbuf::paper {
namespace {

constexpr int kLargestSide = 16384;

cv::Mat load_image(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  const std::vector<std::uint8_t> jpeg(std::istreambuf_iterator<char>(in), {});
  thread_local JpegCodec codec;
  auto image = codec.decode_gray(jpeg, 1);
  if (!image) throw std::runtime_error(file.string() + ": " + image.error().text);
  return cv::Mat(image.value().height_px, image.value().width_px, CV_8U,
                 image.value().pixels.data())
      .clone();
}

struct PipeImage {
  double time_s = 0;
  bool is_right = false;
  cv::Mat pixels;
};

/// The header's next word; what its comments say goes to `image`.
std::string next_word(std::istream& in, PipeImage& image) {
  std::string word;
  while (in >> word && word[0] == '#') {
    std::string comment;
    std::getline(in >> std::ws, comment);
    if (comment.starts_with("t=")) image.time_s = std::stod(comment.substr(2));
    if (comment == "camera=right") image.is_right = true;
  }
  return in ? word : "";
}

std::optional<PipeImage> read_image(std::istream& in) {
  PipeImage image;
  const std::string magic = next_word(in, image);
  if (magic.empty()) return std::nullopt;
  if (magic != "P5") throw std::runtime_error("the pipe does not have PGM images");
  const int width = std::atoi(next_word(in, image).c_str());
  const int height = std::atoi(next_word(in, image).c_str());
  const std::string depth = next_word(in, image);
  if (width < 1 || height < 1 || width > kLargestSide || height > kLargestSide || depth != "255") {
    throw std::runtime_error("the pipe has a PGM image of unusable size or depth");
  }
  in.get();  // the one blank before the pixels
  image.pixels.create(height, width, CV_8U);
  in.read(reinterpret_cast<char*>(image.pixels.data), static_cast<std::streamsize>(width) * height);
  if (!in) throw std::runtime_error("the pipe ends within an image");
  return image;
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

JudgedFrame load_frame(const std::filesystem::path& folder, const ListedFrame& frame,
                       bool with_right) {
  const auto name = fmt::format("{:06}.jpg", frame.id);
  JudgedFrame loaded{frame.time_s, load_image(folder / "images" / name), {}};
  if (with_right) loaded.right = load_image(folder / "images_right" / name);
  return loaded;
}

std::optional<JudgedFrame> read_pipe(std::istream& in, bool is_stereo) {
  const auto left = read_image(in);
  if (!left) return std::nullopt;
  if (left->is_right) throw std::runtime_error("the pipe has a right image without a left one");
  JudgedFrame frame{left->time_s, left->pixels, {}};
  if (!is_stereo) return frame;
  const auto right = read_image(in);
  if (!right || !right->is_right) throw std::runtime_error("the pipe is not stereo");
  frame.right = right->pixels;
  return frame;
}

}  // namespace orbbuf::paper
