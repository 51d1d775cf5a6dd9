// SPDX-License-Identifier: Apache-2.0
// orbbuf-world: renders a drive through a generated place, the true path of which is known. Writes
// a folder that orbbufd replays (images, images_right, times.txt), with camera.txt, truth.txt (TUM:
// the left camera's pose, z ahead, x right, y down) and, if asked, depth (16-bit PGM, millimetres).
#include <fmt/core.h>

#include <atomic>
#include <cmath>
#include <exception>
#include <filesystem>
#include <fstream>
#include <map>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bench/run_program.hpp"
#include "common/command_line.hpp"
#include "common/jpeg.hpp"
#include "common/progress.hpp"
#include "evaluation/world/renderer.hpp"

namespace orbbuf::evaluation {
namespace {

struct Options {
  std::filesystem::path folder;
  std::string place = "corridor";
  std::string size = "640x480";
  bool stereo = false;
  bool depth = false;
  std::uint64_t seed = 1;
  double fps = 25;
  std::size_t frames = 1500;
  int quality = 80;
  double aside_m = 0;
  unsigned threads = 2;
};

const std::map<std::string, Camera> kCameras = {
    {"640x480", {380, 380, 319.5, 239.5, 640, 480, 0}},
    {"1241x376", {718, 718, 620, 187.5, 1241, 376, 0}},
    {"1280x1024", {760, 760, 639.5, 511.5, 1280, 1024, 0}}};

void write(const std::filesystem::path& file, const char* data, std::size_t size) {
  std::ofstream out(file, std::ios::binary);
  out.write(data, static_cast<std::streamsize>(size));
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

void write_jpeg(const std::filesystem::path& file, const cv::Mat& image, int quality) {
  thread_local JpegCodec codec;
  const auto jpeg =
      codec.encode({image.data, image.cols, image.rows, image.step, 1}, quality, false);
  if (!jpeg) throw std::runtime_error(file.string() + ": " + jpeg.error().text);
  write(file, reinterpret_cast<const char*>(jpeg.value().data()), jpeg.value().size());
}

void write_depth(const std::filesystem::path& file, const cv::Mat& depth) {
  std::string text = fmt::format("P5\n{} {}\n65535\n", depth.cols, depth.rows);
  for (const float metres : cv::Mat_<float>(depth)) {
    const auto millimetres = std::min(65535L, std::lround(metres * 1e3F));
    text += static_cast<char>(millimetres >> 8);
    text += static_cast<char>(millimetres & 255);
  }
  write(file, text.data(), text.size());
}

class Drive {
 public:
  Drive(const Options& options, const Style& style, const Camera& camera)
      : options_(options),
        camera_(camera),
        renderer_(style, camera, options.seed, static_cast<double>(options.frames) / options.fps) {}

  void run() {
    for (const char* name : {"images", "images_right", "depth"}) {
      std::filesystem::remove_all(options_.folder / name);
    }
    std::filesystem::create_directories(options_.folder / "images");
    if (camera_.is_stereo()) std::filesystem::create_directories(options_.folder / "images_right");
    if (options_.depth) std::filesystem::create_directories(options_.folder / "depth");
    write_texts(style_exposure_ms());
    Progress progress("render", "frames", options_.frames);
    std::vector<std::jthread> threads;
    for (unsigned i = 0; i < options_.threads; ++i) threads.emplace_back([&] { work(progress); });
    threads.clear();
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  double time_of(std::size_t frame) const {
    return 0.1 + static_cast<double>(frame) / options_.fps;
  }
  double style_exposure_ms() const {
    return (options_.place == "street" ? kStreet : kCorridor).exposure_s * 1e3;
  }

  void work(Progress& progress) {
    try {
      for (std::size_t i = next_++; i < options_.frames; i = next_++) {
        write_frame(i);
        progress.add();
      }
    } catch (...) {
      if (!failed_.exchange(true)) failure_ = std::current_exception();
    }
  }

  void write_frame(std::size_t i) const {
    const Rendered frame = renderer_.render(time_of(i), options_.depth);
    const auto name = fmt::format("{:06}.jpg", i);
    write_jpeg(options_.folder / "images" / name, frame.left, options_.quality);
    if (!frame.right.empty()) {
      write_jpeg(options_.folder / "images_right" / name, frame.right, options_.quality);
    }
    if (options_.depth) {
      write_depth(options_.folder / "depth" / fmt::format("{:06}.pgm", i), frame.depth);
    }
  }

  void write_texts(double exposure_ms) const {
    std::string times;
    std::string truth;
    for (std::size_t i = 0; i < options_.frames; ++i) {
      times += fmt::format("{:06} {:.6f} {:.3f}\n", i, time_of(i), exposure_ms);
      const CameraPose pose = renderer_.route().at(time_of(i));
      // From looking along x with the image's right to -y and its down to -z, turned by heading.
      const double half = pose.heading / 2 - M_PI / 4;
      const double c = std::cos(half) * M_SQRT1_2;
      const double s = std::sin(half) * M_SQRT1_2;
      truth += fmt::format("{:.6f} {:.6f} {:.6f} {:.6f} {:.9f} {:.9f} {:.9f} {:.9f}\n", time_of(i),
                           pose.x, pose.y, pose.z, -c, -s, s, c);
    }
    write(options_.folder / "times.txt", times.data(), times.size());
    write(options_.folder / "truth.txt", truth.data(), truth.size());
    const std::string camera = to_text(camera_);
    write(options_.folder / "camera.txt", camera.data(), camera.size());
  }

  const Options options_;
  const Camera camera_;
  const Renderer renderer_;
  std::atomic<std::size_t> next_ = 0;
  std::atomic<bool> failed_ = false;
  std::exception_ptr failure_;
};

void run(const Options& options) {
  Style style = options.place == "street" ? kStreet : kCorridor;
  style.aside_m = options.aside_m;
  Camera camera = kCameras.at(options.size);
  if (options.stereo) camera.baseline_m = style.baseline_m;
  Drive(options, style, camera).run();
}

}  // namespace
}  // namespace orbbuf::evaluation

int main(int argc, char** argv) {
  orbbuf::evaluation::Options options;
  orbbuf::CommandLine app("Renders a drive through a generated place, with ground truth");
  app.add_option("folder", options.folder, "to write to; images of an earlier run go").required();
  app.add_option("--place", options.place).one_of({"corridor", "street"}).with_default();
  app.add_option("--size", options.size)
      .one_of({"640x480", "1241x376", "1280x1024"})
      .with_default();
  app.add_flag("--stereo", options.stereo);
  app.add_flag("--depth", options.depth, "16-bit PGM, millimetres");
  app.add_option("--seed", options.seed).with_default();
  app.add_option("--fps", options.fps).in_range(0.01, 1e6).with_default();
  app.add_option("--frames", options.frames).in_range(1, 1e9).with_default();
  app.add_option("--quality", options.quality, "of JPEG").in_range(1, 100).with_default();
  app.add_option("--aside", options.aside_m,
                 "metres to the right of where the camera of another pass was")
      .with_default();
  app.add_option("--threads", options.threads).in_range(1, 64).with_default();
  if (const auto status = app.parse(argc, argv)) return *status;
  return orbbuf::bench::run_program("orbbuf-world", [&] { orbbuf::evaluation::run(options); });
}
