// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/folder_replay_source.hpp"

#include <gmock/gmock.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "testing/temporary_folder.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using test::error_of;
using test::read_file;
using test::real_sequence;
using test::TemporaryFolder;
using test::write_file;
using testing::AllOf;
using testing::Each;
using testing::ElementsAreArray;
using testing::EndsWith;
using testing::HasSubstr;
using testing::IsEmpty;

/// Pixels that no decoder could have made up.
cv::Mat pattern(int width, int height, int type) {
  cv::Mat image(height, width, type);
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 65536);
  return image;
}

class FolderReplaySourceTest : public testing::Test {
 protected:
  void write_image(const std::string& name, const cv::Mat& image) {
    std::vector<unsigned char> bytes;
    ASSERT_TRUE(cv::imencode(std::filesystem::path(name).extension().string(), image, bytes));
    write(name, {bytes.begin(), bytes.end()});
  }
  void write(const std::string& name, const std::string& content) {
    std::filesystem::create_directories((folder_ / name).parent_path());
    write_file(folder_ / name, content);
  }
  void truncate(const std::string& name, int percent) {
    const auto size = std::filesystem::file_size(folder_ / name);
    std::filesystem::resize_file(folder_ / name, size * static_cast<unsigned>(percent) / 100);
  }
  SourceSettings settings(const std::string& path = {}) {
    SourceSettings settings;
    settings.path = folder_ / path;
    settings.fps = 10;
    return settings;
  }
  std::vector<RawFrame> replay(const SourceSettings& settings) {
    FolderReplaySource source(settings);
    std::vector<RawFrame> frames;
    while (auto frame = source.next({})) frames.push_back(std::move(*frame));
    return frames;
  }
  std::string error(const SourceSettings& settings) {
    return error_of([&] { FolderReplaySource source(settings); });
  }

  TemporaryFolder folder_;
};

std::vector<std::uint8_t> bytes_of(const std::filesystem::path& file) {
  const auto content = read_file(file);
  return {content.begin(), content.end()};
}

std::vector<std::int64_t> times_of(const std::vector<RawFrame>& frames) {
  std::vector<std::int64_t> times;
  times.reserve(frames.size());
  for (const auto& frame : frames) times.push_back(frame.capture_time_ns);
  return times;
}

void expect_pixels(const RawFrame& frame, const cv::Mat& image) {
  ASSERT_EQ(frame.defect, "");
  ASSERT_EQ(frame.width_px, image.cols);
  ASSERT_EQ(frame.height_px, image.rows);
  EXPECT_EQ(frame.format, image.channels() == 1 ? PixelFormat::kGray8 : PixelFormat::kBgr24);
  const auto row_bytes = image.elemSize() * static_cast<std::size_t>(image.cols);
  ASSERT_GE(frame.data.size(),
            frame.stride_bytes * static_cast<std::size_t>(image.rows - 1) + row_bytes);
  for (int y = 0; y < image.rows; ++y) {
    const auto row =
        frame.data.subspan(frame.stride_bytes * static_cast<std::size_t>(y), row_bytes);
    ASSERT_TRUE(std::equal(row.begin(), row.end(), image.ptr(y))) << "row " << y;
  }
}

TEST_F(FolderReplaySourceTest, ImagesComeInTheOrderOfTheirNamesAndOtherFilesNotAtAll) {
  write_image("b.pgm", pattern(8, 4, CV_8UC1));
  write_image("a.png", pattern(6, 4, CV_8UC1));
  write_image("C.JPG", pattern(16, 16, CV_8UC1));
  write("notes.txt", "not an image");
  write(".hidden.png", "not an image either");
  write("folder.png/readme", "nor is a folder");
  const auto frames = replay(settings());
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_EQ(frames[0].format, PixelFormat::kJpeg);
  EXPECT_EQ(frames[1].width_px, 6);
  EXPECT_EQ(frames[2].width_px, 8);
}

TEST_F(FolderReplaySourceTest, AMillionthImageComesAfterTheOnesBefore) {
  write_image("1000000.png", pattern(8, 8, CV_8UC1));
  write_image("999999.png", pattern(6, 6, CV_8UC1));
  write_image("999998.png", pattern(4, 4, CV_8UC1));
  const auto frames = replay(settings());
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_EQ(frames[0].width_px, 4);
  EXPECT_EQ(frames[1].width_px, 6);
  EXPECT_EQ(frames[2].width_px, 8);
}

TEST_F(FolderReplaySourceTest, NumbersSortAsNumbersWhereverTheyStandInANameAndTimesAsTimes) {
  const auto expect_order = [&](const std::vector<std::string>& names) {
    const TemporaryFolder folder;
    for (auto name = names.rbegin(); name != names.rend(); ++name) {
      write_file(folder / (*name + ".jpg"), *name);
    }
    auto from = settings();
    from.path = folder.path();
    std::vector<std::string> got;
    for (const auto& frame : replay(from)) got.emplace_back(frame.data.begin(), frame.data.end());
    EXPECT_EQ(got, names);
  };
  expect_order({"frame1", "frame2", "frame9", "frame10", "frame12", "frame100"});
  expect_order({"a1-b2", "a1-b10", "a2-b1", "a10-b1", "b1"});
  expect_order({"007", "7", "08", "99999999999999999999", "100000000000000000000"});
  expect_order({"9.5", "10.1753", "10.175304", "10.2", "10.20"});
  expect_order({"cam1.2", "cam1.10"});
  expect_order({"a", "a0", "a1", "aa"});
}

TEST_F(FolderReplaySourceTest, DataSetsAreRecognisedByTheirFilesOfTimes) {
  const std::string csv = "#timestamp [ns],filename\n1403636579763555584,1403636579763555584.jpg\n";
  for (const auto& [images, times, text, time_ns, layout] :
       {std::tuple("mav0/cam0/data/1403636579763555584.jpg", "mav0/cam0/data.csv", csv.c_str(),
                   1'403'636'579'763'555'584, "EuRoC"),
        {"rgb/1.5.jpg", "rgb.txt", "# color\n1.5 rgb/1.5.jpg\n", 1'500'000'000, "TUM RGB-D"},
        {"image_0/000000.jpg", "times.txt", "2.5e+00\n", 2'500'000'000, "KITTI odometry"},
        {"image_00/data/0000000000.jpg", "image_00/timestamps.txt", "1970-01-01 00:00:03.5\n",
         3'500'000'000, "KITTI raw"}}) {
    const TemporaryFolder set;
    for (const auto& [name, content] : {std::pair(images, "jpeg"), {times, text}}) {
      std::filesystem::create_directories((set / name).parent_path());
      write_file(set / name, content);
    }
    auto from = settings();
    for (from.path = (set / images).parent_path();; from.path = from.path.parent_path()) {
      EXPECT_THAT(times_of(replay(from)), testing::ElementsAre(time_ns)) << from.path;
      EXPECT_THAT(FolderReplaySource(from).description(),
                  EndsWith((set / times).string() + " (" + layout + ")"));
      if (from.path == set.path()) break;
    }
  }
}

TEST_F(FolderReplaySourceTest, AListBesideAFolderOfAnotherNameIsNoFileOfTimes) {
  write("frames/1.jpg", "jpeg");
  for (const auto* list : {"data.csv", "rgb.txt", "timestamps.txt"}) write(list, "no times");
  EXPECT_THAT(times_of(replay(settings("frames"))), testing::ElementsAre(0));
}

TEST_F(FolderReplaySourceTest, GrayImagesKeepEveryPixelWhateverTheirSizes) {
  const auto png = pattern(37, 11, CV_8UC1);
  const auto pgm = pattern(1, 3, CV_8UC1);
  write_image("1.png", png);
  write_image("2.pgm", pgm);
  const auto frames = replay(settings());
  ASSERT_EQ(frames.size(), 2U);
  expect_pixels(frames[0], png);
  expect_pixels(frames[1], pgm);
}

TEST_F(FolderReplaySourceTest, ColourIsKeptWhereAskedForAndElseMadeGray) {
  const auto colour = pattern(20, 10, CV_8UC3);
  write_image("1.png", colour);
  auto in_colour = settings();
  in_colour.color = true;
  expect_pixels(replay(in_colour).at(0), colour);
  EXPECT_EQ(replay(settings()).at(0).format, PixelFormat::kGray8);
}

TEST_F(FolderReplaySourceTest, WhiteIsTheLargestValueOfSixteenBits) {
  cv::Mat deep = pattern(20, 10, CV_16UC1) / 4;  // no pixel is white
  write_image("1.png", deep);
  write_image("2.pgm", deep);
  cv::Mat expected;
  deep.convertTo(expected, CV_8U, 1.0 / 257);
  const auto frames = replay(settings());
  ASSERT_EQ(frames.size(), 2U);
  expect_pixels(frames[0], expected);
  expect_pixels(frames[1], expected);
}

TEST_F(FolderReplaySourceTest, WhiteIsTheMaxvalOfAPgm) {
  using namespace std::string_literals;
  write("1.pgm", "P5 3 1 1023\n\x00\x00\x02\x00\x03\xFF"s);
  write("2.pgm", "P5\n# a comment\n3 1\n# another\n15\n\x00\x08\x0F"s);
  write("3.pgm", "P2\n3 1 1023\n0 512 1023\n");
  write("4.pgm", "P2\n3 1\n15\n0 8 15\n");
  write("5.pgm", "P5 3 1 255\n\x00\x80\x90"s);
  auto in_colour = settings();
  in_colour.color = true;
  for (const RawFrame& frame : replay(in_colour)) EXPECT_EQ(frame.defect, "");
  const auto frames = replay(settings());
  ASSERT_EQ(frames.size(), 5U);
  EXPECT_THAT(frames[0].data, testing::ElementsAre(0, 128, 255));
  EXPECT_THAT(frames[1].data, testing::ElementsAre(0, 136, 255));
  EXPECT_THAT(frames[2].data, testing::ElementsAre(0, 128, 255));
  EXPECT_THAT(frames[3].data, testing::ElementsAre(0, 136, 255));
  EXPECT_THAT(frames[4].data, testing::ElementsAre(0, 128, 144));
}

TEST_F(FolderReplaySourceTest, JpegFilesArePassedOnByteForByte) {
  write_image("1.jpeg", pattern(33, 17, CV_8UC3));
  const auto frames = replay(settings());
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_EQ(frames[0].format, PixelFormat::kJpeg);
  EXPECT_EQ(frames[0].width_px, 0);
  EXPECT_THAT(frames[0].data, ElementsAreArray(bytes_of(folder_ / "1.jpeg")));
}

TEST_F(FolderReplaySourceTest, WhatIsCutShortOrNoImageIsADefectInItsPlace) {
  for (const auto* name : {"1.png", "2.pgm", "3.png", "4.pgm"}) {
    write_image(name, pattern(64, 48, CV_8UC1));
  }
  truncate("1.png", 50);
  truncate("2.pgm", 99);
  truncate("3.png", 1);
  truncate("4.pgm", 0);
  write("5.png", "just some text");
  write("6.jpg", "");
  std::filesystem::create_symlink("nowhere", folder_ / "7.png");
  write_image("8.png", pattern(64, 48, CV_8UC1));
  const auto frames = replay(settings());
  ASSERT_EQ(frames.size(), 8U);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_THAT(frames[i].defect,
                HasSubstr("cannot read " + (folder_ / std::to_string(i + 1)).string()));
    EXPECT_THAT(frames[i].data, IsEmpty());
    EXPECT_EQ(frames[i].capture_time_ns, static_cast<std::int64_t>(i) * 100'000'000);
  }
  EXPECT_THAT(frames[3].defect, EndsWith("4.pgm: the file is empty"));
  EXPECT_THAT(frames[6].defect, EndsWith("7.png: No such file or directory"));
  EXPECT_EQ(frames[7].defect, "");
}

TEST_F(FolderReplaySourceTest, AFrameOutlivesItsSource) {
  const auto image = pattern(37, 11, CV_8UC1);
  write_image("1.png", image);
  const auto frames = replay(settings());
  std::filesystem::remove(folder_ / "1.png");
  expect_pixels(frames.at(0), image);
}

TEST_F(FolderReplaySourceTest, WithoutTimesTheRateGivesThem) {
  for (const auto* name : {"1.png", "2.png", "3.png", "4.png"}) {
    write_image(name, pattern(8, 8, CV_8UC1));
  }
  auto thirds = settings();
  thirds.fps = 3;
  EXPECT_THAT(times_of(replay(thirds)),
              testing::ElementsAre(0, 333'333'333, 666'666'667, 1'000'000'000));
}

TEST_F(FolderReplaySourceTest, TimesAreFoundInTheFolderAndElseBesideIt) {
  write_image("images/1.png", pattern(8, 8, CV_8UC1));
  write("times.txt", "1 5.5 2.5\n");
  for (const auto* path : {"images", "images/", "", "."}) {
    const auto frames = replay(settings(path));
    ASSERT_EQ(frames.size(), 1U) << path;
    EXPECT_EQ(frames[0].capture_time_ns, 5'500'000'000);
    EXPECT_EQ(frames[0].exposure_ns, 2'500'000U);
  }
  write("images/times.txt", "7.0\n");
  EXPECT_THAT(times_of(replay(settings())), testing::ElementsAre(7'000'000'000));
}

TEST_F(FolderReplaySourceTest, TimesThatCannotBeUsedStopTheStart) {
  write_image("1.png", pattern(8, 8, CV_8UC1));
  write("times.txt", "now\n");
  EXPECT_THAT(error(settings()), AllOf(HasSubstr((folder_ / "times.txt").string()),
                                       EndsWith("line 1: 'now' is not a time in seconds")));
}

TEST_F(FolderReplaySourceTest, WhatIsNoFolderOfImagesStopsTheStartWithTheReason) {
  write("file", "x");
  write("empty/readme.txt", "x");
  write("odd/images", "a file");
  EXPECT_THAT(error(settings("none")), EndsWith("none: No such file or directory"));
  EXPECT_THAT(error(settings("file")), EndsWith("file: not a folder"));
  for (const auto* path : {"empty", "odd"}) {
    EXPECT_THAT(error(settings(path)), AllOf(HasSubstr((folder_ / path).string()),
                                             HasSubstr("no png, jpg, jpeg or pgm file")));
  }
  EXPECT_THAT(error({}), HasSubstr("source.path is not set"));
}

TEST_F(FolderReplaySourceTest, TwoFoldersGivePairsInTheOrderOfTheirNames) {
  const auto left = pattern(8, 4, CV_8UC1);
  const cv::Mat right = 255 - left;
  for (const auto* name : {"1", "2"}) {
    write_image(std::string("images/") + name + ".png", left);
    write_image(std::string("right/a") + name + ".pgm", right);
  }
  write("times.txt", "1 5.5\n2 6.5\n");
  auto stereo = settings();
  stereo.path_right = folder_ / "right";
  const auto frames = replay(stereo);
  EXPECT_THAT(times_of(frames), testing::ElementsAre(5'500'000'000, 6'500'000'000));
  for (const auto& frame : frames) {
    expect_pixels(frame, left);
    expect_pixels(*frame.right, right);
  }
  EXPECT_THAT(FolderReplaySource(stereo).description(), HasSubstr("right: 2 pairs of images"));
}

TEST_F(FolderReplaySourceTest, RightImagesThatCannotBePairsStopTheStart) {
  write_image("left/1.png", pattern(8, 4, CV_8UC1));
  write_image("right/1.png", pattern(8, 4, CV_8UC1));
  write_image("right/2.png", pattern(8, 4, CV_8UC1));
  auto stereo = settings("left");
  stereo.path_right = folder_ / "right";
  EXPECT_THAT(error(stereo), AllOf(HasSubstr("right as the right images of "),
                                   EndsWith("left: 2 right images, 1 left images")));
  stereo.path_right = folder_ / "left/";
  EXPECT_THAT(error(stereo), EndsWith("both are the same folder"));
  stereo.path_right = folder_ / "none";
  EXPECT_THAT(error(stereo), EndsWith("none: No such file or directory"));
}

TEST_F(FolderReplaySourceTest, AStopEndsIt) {
  write_image("1.png", pattern(8, 8, CV_8UC1));
  FolderReplaySource source(settings());
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(source.next(stop.get_token()));
}

TEST_F(FolderReplaySourceTest, ReplaysARealJpegSequence) {
  SourceSettings picar;
  picar.path = real_sequence("picar_indoor");
  if (!exists(picar.path)) GTEST_SKIP() << picar.path << " is absent";
  const auto frames = replay(picar);
  ASSERT_EQ(frames.size(), 290U);
  EXPECT_THAT(frames[0].data, ElementsAreArray(bytes_of(picar.path / "images/000000.jpg")));
  EXPECT_THAT(frames[289].data, ElementsAreArray(bytes_of(picar.path / "images/000289.jpg")));
  EXPECT_EQ(frames[0].capture_time_ns, 31'463'291'000'000);
  EXPECT_EQ(frames[1].capture_time_ns, 31'463'395'000'000);
  EXPECT_EQ(frames[289].capture_time_ns, 31'491'632'000'000);
}

TEST_F(FolderReplaySourceTest, ReplaysRealPngSequences) {
  for (const auto& [name, count, last_ns] :
       {std::tuple("kitti06_mono", 51U, 5'195'994'000), {"kitti05_stereo", 60U, 6'118'300'000}}) {
    SourceSettings kitti;
    kitti.path = real_sequence(name);
    if (!exists(kitti.path)) GTEST_SKIP() << kitti.path << " is absent";
    const auto frames = replay(kitti);
    ASSERT_EQ(frames.size(), count);
    EXPECT_EQ(frames.front().capture_time_ns, 0);
    EXPECT_EQ(frames.back().capture_time_ns, last_ns);
    EXPECT_THAT(frames, Each(testing::Field(&RawFrame::width_px, 1226)));
    EXPECT_THAT(frames, Each(testing::Field(&RawFrame::defect, "")));
  }
}

}  // namespace
}  // namespace orbbuf
