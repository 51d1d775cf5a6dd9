// SPDX-License-Identifier: Apache-2.0
#include "bench/core/requantising.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <limits>
#include <list>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "common/jpeg.hpp"
#include "daemon/capture/make_source.hpp"
#include "daemon/image/requantiser.hpp"

namespace orbbuf::bench {
namespace {

constexpr std::size_t kImages = 12;  // of each sequence
constexpr int kRepetitions = 40;     // interleaved; the fastest of each counts
constexpr int kWhole = 80, kReduced = 30;

std::vector<std::filesystem::path> files_of(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Four frames of a sequence side by side, cut to `size`: as much detail for each pixel as the
/// frames have, at any size.
std::vector<cv::Mat> recorded(const std::filesystem::path& folder, cv::Size size, bool color) {
  const auto files = files_of(folder);
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < kImages; ++i) {
    std::array<cv::Mat, 4> part;
    for (std::size_t j = 0; j < part.size(); ++j) {
      part[j] = cv::imread(files[(4 * i + j) * files.size() / (4 * kImages)].string(),
                           color ? cv::IMREAD_COLOR : cv::IMREAD_GRAYSCALE);
    }
    cv::Mat upper, lower, whole;
    cv::hconcat(part[0], part[1], upper);
    cv::hconcat(part[2], part[3], lower);
    cv::vconcat(upper, lower, whole);
    images.push_back(whole({(whole.cols - size.width) / 2, (whole.rows - size.height) / 2,
                            size.width, size.height})
                         .clone());
  }
  return images;
}

std::vector<cv::Mat> generated(cv::Size size, bool color) {
  SourceSettings settings;
  settings.width_px = size.width;
  settings.height_px = size.height;
  settings.color = color;
  settings.realtime = false;
  const auto source = make_source(settings);
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < kImages; ++i) {
    const auto raw = source->next({});
    images.push_back(cv::Mat(size, color ? CV_8UC3 : CV_8UC1,
                             const_cast<std::uint8_t*>(raw->data.data()), raw->stride_bytes)
                         .clone());
  }
  return images;
}

double thread_us() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) / 1e3;
}

/// The images of a sequence and both ways to make them small.
class Comparison {
 public:
  Comparison(std::string name, std::vector<cv::Mat> images)
      : name_(std::move(name)), images_(std::move(images)) {
    for (const cv::Mat& image : images_) {
      EncodedFrame frame;
      frame.jpeg = encode(image, kWhole);
      frames_.push_back(std::move(frame));
    }
  }

  const std::string& name() const { return name_; }

  /// The time of reducing over that of encoding.
  double cost() {
    double encoding_us = 0;
    double reducing_us = 0;
    for (std::size_t i = 0; i < images_.size(); ++i) {
      std::array<double, 2> fastest_us;
      fastest_us.fill(std::numeric_limits<double>::max());
      for (int repetition = 0; repetition < kRepetitions; ++repetition) {
        const double start_us = thread_us();
        encode(images_[i], kWhole);
        const double middle_us = thread_us();
        static_cast<void>(requantiser_.reduce(frames_[i], kReduced).value());
        fastest_us[0] = std::min(fastest_us[0], middle_us - start_us);
        fastest_us[1] = std::min(fastest_us[1], thread_us() - middle_us);
      }
      encoding_us += fastest_us[0];
      reducing_us += fastest_us[1];
    }
    return reducing_us / encoding_us;
  }

  struct Loss {
    double db = 0;           // of the image encoded so from the start, over the reduced one
    double gain_db = 0;      // of the reduced one, over one encoded from the start to its bytes
    double bytes_ratio = 0;  // of the reduced one to that encoded so from the start
    double whole_ratio = 0;  // of the whole one to the reduced one
  };

  Loss loss(int quality) {
    Loss loss;
    double whole_bytes = 0, reduced_bytes = 0, direct_bytes = 0;
    const auto count = static_cast<double>(images_.size());
    for (std::size_t i = 0; i < images_.size(); ++i) {
      const auto reduced = requantiser_.reduce(frames_[i], quality).value().jpeg;
      auto direct = encode(images_[i], quality);
      const double reduced_db = psnr_db(images_[i], reduced);
      whole_bytes += static_cast<double>(frames_[i].jpeg.size());
      reduced_bytes += static_cast<double>(reduced.size());
      direct_bytes += static_cast<double>(direct.size());
      loss.db += (psnr_db(images_[i], direct) - reduced_db) / count;
      for (int q = quality; q > 1 && direct.size() > reduced.size(); --q) {
        direct = encode(images_[i], q);
      }
      loss.gain_db += (reduced_db - psnr_db(images_[i], direct)) / count;
    }
    loss.bytes_ratio = reduced_bytes / direct_bytes;
    loss.whole_ratio = whole_bytes / reduced_bytes;
    return loss;
  }

 private:
  std::vector<std::uint8_t> encode(const cv::Mat& image, int quality) {
    const bool is_color = image.channels() == 3;
    return codec_
        .encode({image.data, image.cols, image.rows, image.step[0], image.channels()}, quality,
                is_color)
        .value();
  }

  double psnr_db(const cv::Mat& image, const std::vector<std::uint8_t>& jpeg) {
    cv::Mat gray = image;
    if (image.channels() == 3) cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
    auto decoded = codec_.decode_gray(jpeg, 1).value();
    return cv::PSNR(gray, cv::Mat(gray.size(), CV_8UC1, decoded.pixels.data()));
  }

  std::string name_;
  std::vector<cv::Mat> images_;
  std::vector<EncodedFrame> frames_;
  JpegCodec codec_;
  Requantiser requantiser_;
};

std::list<Comparison> comparisons(const std::filesystem::path& data, cv::Size size, bool color) {
  std::list<Comparison> all;
  for (const char* name : {"picar_indoor", "tsukuba_synth", "kitti06_mono"}) {
    const auto folder = data / name / "images";
    const bool is_gray = std::string_view(name) == "kitti06_mono";
    if (std::filesystem::exists(folder) && !(color && is_gray)) {
      all.emplace_back(name, recorded(folder, size, color));
    }
  }
  if (all.empty()) all.emplace_back("generated", generated(size, color));
  return all;
}

void print_losses(std::list<Comparison> sequences) {
  fmt::print("640x480, gray, from quality {}; \"direct\": encoded so from the start\n", kWhole);
  for (const int quality : {50, 30, 20}) {
    double mean_db = 0;
    for (Comparison& sequence : sequences) {
      const auto loss = sequence.loss(quality);
      fmt::print(
          "{:14} quality {}: 1/{:.2f} of the bytes, {:.3f} of direct; {:.2f} dB under direct, "
          "{:.2f} dB over direct of the same size\n",
          sequence.name(), quality, loss.whole_ratio, loss.bytes_ratio, loss.db, loss.gain_db);
      mean_db += loss.db / static_cast<double>(sequences.size());
    }
    fmt::print("RESULT core.requantise_loss_db.{} {:.3f}\n", quality, mean_db);
  }
}

}  // namespace

void measure_requantising(const std::filesystem::path& data) {
  for (const bool color : {false, true}) {
    for (const cv::Size size : {cv::Size(640, 480), cv::Size(1280, 720)}) {
      double worst = 0;
      for (Comparison& sequence : comparisons(data, size, color)) {
        worst = std::max(worst, sequence.cost());
      }
      fmt::print("RESULT core.requantise_ratio.{}x{}{} {:.3f}\n", size.width, size.height,
                 color ? "_color" : "", worst);
    }
  }
  print_losses(comparisons(data, {640, 480}, false));
}

}  // namespace orbbuf::bench
