// SPDX-License-Identifier: Apache-2.0
// Each layout read back by code that shares nothing with the exporter: its index by the lines, its
// images by OpenCV.
#include "server/dataset/layouts.hpp"

#include <gmock/gmock.h>

#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "server/dataset/export_session.hpp"
#include "tests/server/dataset/recording.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::read_file;
using test::read_lines;
using testing::IsEmpty;

/// A frame as a loader has it.
struct Loaded {
  double time_s = 0;
  std::string left;
  std::string right;  // paths in the folder
};

std::vector<std::string> split(const std::string& line, char at) {
  std::vector<std::string> fields;
  std::istringstream in(line);
  for (std::string field; std::getline(in, field, at);) fields.push_back(field);
  return fields;
}

/// As ORB-SLAM3's and Basalt's EuRoC loaders do.
std::vector<Loaded> load_euroc(const fs::path& folder) {
  std::vector<Loaded> frames;
  for (const std::string& line : read_lines(folder / "mav0/cam0/data.csv")) {
    if (line.starts_with('#')) continue;
    const auto fields = split(line, ',');
    frames.push_back({std::stod(fields.at(0)) / 1e9, "mav0/cam0/data/" + fields.at(1),
                      "mav0/cam1/data/" + fields.at(1)});
  }
  return frames;
}

/// As ORB-SLAM's KITTI loader does.
std::vector<Loaded> load_kitti(const fs::path& folder, const std::string& extension) {
  std::vector<Loaded> frames;
  for (const std::string& line : read_lines(folder / "times.txt")) {
    std::string number = std::to_string(frames.size());
    number.insert(0, 6 - number.size(), '0');
    frames.push_back(
        {std::stod(line), "image_0/" + number + extension, "image_1/" + number + extension});
  }
  return frames;
}

/// As the TUM RGB-D tools do.
std::vector<Loaded> load_tum_rgbd(const fs::path& folder) {
  std::vector<Loaded> frames;
  for (const std::string& line : read_lines(folder / "rgb.txt")) {
    if (line.starts_with('#')) continue;
    const auto fields = split(line, ' ');
    frames.push_back({std::stod(fields.at(0)), fields.at(1), ""});
  }
  return frames;
}

/// As DSO does: times by their place among the images.
std::vector<Loaded> load_tum_mono(const fs::path& folder) {
  std::vector<Loaded> frames;
  for (const std::string& line : read_lines(folder / "times.txt")) {
    int id = 0;
    double time_s = 0;
    float exposure = 0;
    EXPECT_EQ(std::sscanf(line.c_str(), "%d %lf %f", &id, &time_s, &exposure), 3);
    frames.push_back({time_s, "", ""});
  }
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder / "images")) {
    names.push_back(entry.path().filename());
  }
  std::ranges::sort(names);
  EXPECT_EQ(names.size(), frames.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    frames[i].left = "images/" + names[i];
    frames[i].right = "images_right/" + names[i];
  }
  return frames;
}

class LayoutTest : public test::Recording {
 protected:
  ExportReport exported(Layout layout, const std::string& extension = "jpg") const {
    auto report = export_session(session_, out_, layout, extension);
    EXPECT_TRUE(report) << (report ? "" : report.error().text);
    return report ? std::move(report).value() : ExportReport{};
  }

  /// Times to the microsecond, images to the byte, and OpenCV sees what was captured.
  void expect_as_recorded(const std::vector<Loaded>& frames, bool is_stereo) const {
    ASSERT_EQ(frames.size(), delivered().size());
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const Sequence sequence = delivered()[i];
      EXPECT_NEAR(frames[i].time_s, static_cast<double>(sequence) * 0.04, 1e-6);
      expect_image(frames[i].left, sequence);
      if (is_stereo) expect_image(frames[i].right, sequence + 100);
    }
  }
  void expect_image(const std::string& path, Sequence of) const {
    const auto jpeg = test::jpeg_frame_ptr(of, kWidth, kHeight)->jpeg;
    EXPECT_EQ(read_file(out_ / path), test::as_text(jpeg)) << path;
    const cv::Mat pixels = cv::imread((out_ / path).string(), cv::IMREAD_GRAYSCALE);
    EXPECT_EQ(pixels.cols, kWidth) << path;
    EXPECT_EQ(pixels.rows, kHeight) << path;
    const cv::Mat expected = cv::imdecode(jpeg, cv::IMREAD_GRAYSCALE);
    EXPECT_TRUE(std::equal(pixels.begin<std::uint8_t>(), pixels.end<std::uint8_t>(),
                           expected.begin<std::uint8_t>(), expected.end<std::uint8_t>()));
  }

  const fs::path out_ = folder_ / "out";
};

TEST_F(LayoutTest, TumMonoIsTheSessionAgain) {
  const auto store = begin(true, "Pinhole 50 51 32 24 0\n64 48\nnone\n64 48\n0.1\n");
  EncodedFrame known = *frame(10, true);
  known.quality = 80;
  ASSERT_FALSE(store->write(known, 0));
  ASSERT_FALSE(store->finish(true));
  test::write_file(session_ / "images/stray.jpg", "no frame");
  EXPECT_THAT(exported(Layout::kTumMono).notes, IsEmpty());
  auto frames = load_tum_mono(out_);
  ASSERT_FALSE(frames.empty());
  frames.pop_back();
  expect_as_recorded(frames, true);
  for (const char* file :
       {"times.txt", "drops.csv", "camera.txt", "checksums.sfv", "quality.csv"}) {
    EXPECT_EQ(read_file(out_ / file), read_file(session_ / file)) << file;
    EXPECT_FALSE(read_file(out_ / file).empty()) << file;
  }
}

TEST_F(LayoutTest, NamesOfMoreThanAMillionFramesSort) {
  const auto store = open();
  for (const Sequence sequence : {999'999U, 1'000'000U}) {
    ASSERT_FALSE(store->write(*frame(sequence), 0));
  }
  exported(Layout::kTumMono);
  EXPECT_TRUE(fs::exists(out_ / "images/000999999.jpg"));
  EXPECT_TRUE(fs::exists(out_ / "images/001000000.jpg"));
}

TEST_F(LayoutTest, Euroc) {
  record();
  exported(Layout::kEuroc);
  expect_as_recorded(load_euroc(out_), false);
  EXPECT_EQ(read_lines(out_ / "mav0/cam0/data.csv").at(4),
            "0000000000200000000,0000000000200000000.jpg");
  EXPECT_FALSE(fs::exists(out_ / "mav0/cam1"));
}

TEST_F(LayoutTest, EurocOfPairs) {
  record(true);
  exported(Layout::kEuroc);
  expect_as_recorded(load_euroc(out_), true);
  EXPECT_EQ(read_file(out_ / "mav0/cam1/data.csv"), read_file(out_ / "mav0/cam0/data.csv"));
}

TEST_F(LayoutTest, Kitti) {
  record();
  exported(Layout::kKitti);
  expect_as_recorded(load_kitti(out_, ".jpg"), false);
  EXPECT_FALSE(fs::exists(out_ / "image_1"));
}

TEST_F(LayoutTest, KittiOfPairsWithTheNamesItsLoadersLookFor) {
  record(true);
  exported(Layout::kKitti, "png");
  expect_as_recorded(load_kitti(out_, ".png"), true);
}

TEST_F(LayoutTest, TumRgbd) {
  record();
  exported(Layout::kTumRgbd);
  expect_as_recorded(load_tum_rgbd(out_), false);
}

TEST_F(LayoutTest, TumRgbdOfPairsHasTheLeftImages) {
  record(true, "Pinhole 50 51 32 24 0\n64 48\nnone\n64 48\n0.1\n");
  EXPECT_EQ(exported(Layout::kTumRgbd).notes.size(), 2U);
  expect_as_recorded(load_tum_rgbd(out_), false);
}

TEST_F(LayoutTest, EurocsNamesSortAsTimes) {
  const auto store = open();
  for (const std::int64_t seconds : {0, 9, 10}) {
    EncodedFrame each = *frame(static_cast<Sequence>(seconds));
    each.capture_time_ns = seconds * 1'000'000'000;
    ASSERT_FALSE(store->write(each, 0));
  }
  exported(Layout::kEuroc);
  std::vector<std::string> names;
  for (const Loaded& each : load_euroc(out_)) names.push_back(each.left);
  EXPECT_TRUE(std::ranges::is_sorted(names)) << testing::PrintToString(names);
}

TEST_F(LayoutTest, TimesOfOurDayAreExact) {
  EncodedFrame today = *frame(0);
  today.capture_time_ns = 1'763'779'406'123'456'789;
  ASSERT_FALSE(open()->write(today, 0));
  for (const Layout layout : {Layout::kEuroc, Layout::kKitti, Layout::kTumRgbd}) {
    exported(layout);
    const std::string time = layout == Layout::kEuroc   ? load_euroc(out_).at(0).left
                             : layout == Layout::kKitti ? read_file(out_ / "times.txt")
                                                        : read_file(out_ / "rgb.txt");
    EXPECT_THAT(time, testing::HasSubstr(layout == Layout::kEuroc ? "1763779406123456789"
                                                                  : "1763779406.123456789"));
    fs::remove_all(out_);
  }
}

}  // namespace
}  // namespace orbbuf
