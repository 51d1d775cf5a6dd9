// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/times_file.hpp"

#include <gmock/gmock.h>

#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using test::error_of;
using test::TemporaryFolder;
using test::write_file;
using testing::AllOf;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;

using Names = std::vector<std::string>;

class TimesFile : public testing::Test {
 protected:
  std::vector<ImageTime> read(std::string_view content, const Names& names,
                              const char* file = "times.txt") {
    write_file(folder_ / file, std::string(content));
    auto read = read_times_file(folder_ / file, names);
    layout_ = read.layout;
    return std::move(read.times);
  }
  std::string error(std::string_view content, const Names& names) {
    return error_of([&] { read(content, names); });
  }

  TemporaryFolder folder_;
  std::string_view layout_;
};

TEST(ParseDecimal, IsExactWhereDoubleIsNot) {
  EXPECT_EQ(parse_decimal("31463.291", 9), 31'463'291'000'000);
  EXPECT_EQ(parse_decimal("1305031102.175304", 9), 1'305'031'102'175'304'000);
  EXPECT_EQ(parse_decimal("1403636579.763555584", 9), 1'403'636'579'763'555'584);
  EXPECT_EQ(parse_decimal("9223372036.854775807", 9), INT64_MAX);
  EXPECT_EQ(parse_decimal("0.1", 9), 100'000'000);
  EXPECT_EQ(parse_decimal("10.5", 6), 10'500'000);
}

TEST(ParseDecimal, CutsOffWhatIsSmallerThanAUnit) {
  EXPECT_EQ(parse_decimal("1.0000000019", 9), 1'000'000'001);
  EXPECT_EQ(parse_decimal("0.0000000009", 9), 0);
}

TEST(ParseDecimal, TakesKittisExponents) {
  EXPECT_EQ(parse_decimal("0.000000e+00", 9), 0);
  EXPECT_EQ(parse_decimal("1.039360e-01", 9), 103'936'000);
  EXPECT_EQ(parse_decimal("1.143945E+02", 9), 114'394'500'000);
  EXPECT_EQ(parse_decimal("5e1", 0), 50);
  EXPECT_EQ(parse_decimal("1e-30", 9), 0);
}

TEST(ParseDecimal, TakesNumbersWithoutDigitsOnOneSideOfThePoint) {
  EXPECT_EQ(parse_decimal("7", 9), 7'000'000'000);
  EXPECT_EQ(parse_decimal("7.", 9), 7'000'000'000);
  EXPECT_EQ(parse_decimal(".5", 9), 500'000'000);
  EXPECT_EQ(parse_decimal("000000000000000000000000000001", 9), 1'000'000'000);
}

TEST(ParseDecimal, RefusesWhatIsNoNumberOrTooLarge) {
  for (const auto* text : {"", ".", "-1", "+1", "1.2.3", "1,5", "0x10", "nan", "inf", "1e", "1e+",
                           "1e+-5", "1e1.5", "e5", "1 2", "abc", "00001.png", "1e999999999999"}) {
    EXPECT_EQ(parse_decimal(text, 9), std::nullopt) << text;
  }
  EXPECT_EQ(parse_decimal("9223372036.854775808", 9), std::nullopt);
  EXPECT_EQ(parse_decimal("1403636579763555584", 9), std::nullopt) << "nanoseconds, not seconds";
}

TEST_F(TimesFile, OneFieldIsTheTimeOfTheImageInThatPlace) {
  EXPECT_THAT(read("0.000000e+00\n1.039360e-01\n", {"000000.png", "000001.png"}),
              ElementsAre(ImageTime{0, 0}, ImageTime{103'936'000, 0}));
}

TEST_F(TimesFile, TheFormNamesTheDataSetsLayout) {
  read("1.0\n", {"a.png"});
  EXPECT_EQ(layout_, "KITTI odometry");
  read("1.0 rgb/a.png\n", {"a.png"});
  EXPECT_EQ(layout_, "TUM RGB-D");
  for (const auto* line : {"0 1.0\n", "0 1.0 0.5\n"}) {
    read(line, {"a.png"});
    EXPECT_EQ(layout_, "TUM monoVO");
  }
}

TEST_F(TimesFile, EurocsIndexHasNanosecondsAndNames) {
  EXPECT_THAT(read("#timestamp [ns],filename\r\n1403636579763555584,b.png\r\n"
                   "0000000000040000000,a.png\r\n",
                   {"a.png", "b.png"}, "data.csv"),
              ElementsAre(ImageTime{40'000'000, 0}, ImageTime{1'403'636'579'763'555'584, 0}));
  EXPECT_EQ(layout_, "EuRoC");
  EXPECT_THAT(error_of([&] { read("soon,a.png\n", {"a.png"}, "data.csv"); }),
              EndsWith("line 1: 'soon' is not a time in nanoseconds"));
}

TEST_F(TimesFile, KittiRawHasADateAndATimeOfDayInUtc) {
  const Names names{"0000000000.png", "0000000001.png"};
  EXPECT_THAT(read("2011-09-26 13:02:25.964389445\n2011-09-27 00:00:00.068158000\n", names),
              ElementsAre(ImageTime{1'317'042'145'964'389'445, 0},
                          ImageTime{1'317'081'600'068'158'000, 0}));
  EXPECT_EQ(layout_, "KITTI raw");
  EXPECT_THAT(error("2011-09-26 13:02:25.9\n2011-09-26 13:02\n", names),
              EndsWith("line 2: '2011-09-26' is not a date with a time of day"));
  for (const auto* none :
       {"2011-02-29 13:02:25\n", "2011-09-26 24:00:00\n", "2011-09-26 13:60:00\n",
        "2011-09-26 13:00:61\n", "1969-09-26 13:00:00\n", "2262-09-26 13:00:00\n",
        "2011-09-x 13:00:00\n"}) {
    EXPECT_THAT(error(none, {"a.png"}), HasSubstr("line ")) << none;
  }
  EXPECT_THAT(error("2011-09-26 13:02:25.9\n", names), EndsWith("1 times for 2 images"));
}

TEST_F(TimesFile, CommentsBlankLinesAndCarriageReturnsDoNotCount) {
  EXPECT_THAT(read("# seconds\r\n\r\n 1.5 # first\r\n\t\n2.5\r\n#", {"a.png", "b.png"}),
              ElementsAre(ImageTime{1'500'000'000, 0}, ImageTime{2'500'000'000, 0}));
}

TEST_F(TimesFile, ANameIsMatchedWhateverTheOrderAndTheFolderBeforeIt) {
  EXPECT_THAT(read("2.0 rgb/b.png\n1.0 rgb/a.png\n9.0 rgb/absent.png\n", {"a.png", "b.png"}),
              ElementsAre(ImageTime{1'000'000'000, 0}, ImageTime{2'000'000'000, 0}));
}

TEST_F(TimesFile, AnIdIsTheNumberThatTheNameConsistsOf) {
  EXPECT_THAT(read("00099 1.0 0.5\n00100 2.0 10.25\n00101 3.0 0\n", {"00100.jpg", "00101.jpg"}),
              ElementsAre(ImageTime{2'000'000'000, 10'250'000}, ImageTime{3'000'000'000, 0}));
}

TEST_F(TimesFile, AnIdIsThePlaceWhereNamesAreNotNumbers) {
  EXPECT_THAT(read("0 1.0\n1 2.0\n", {"left0.png", "left1.png"}),
              ElementsAre(ImageTime{1'000'000'000, 0}, ImageTime{2'000'000'000, 0}));
}

TEST_F(TimesFile, AnImageWithoutALineIsNamed) {
  EXPECT_THAT(error("1.0 a.png\n", {"a.png", "b.png"}),
              AllOf(HasSubstr("times.txt: "), EndsWith("no line for image b.png")));
  EXPECT_THAT(error("0 1.0\n1 2.0\n", {"00001.png", "00002.png"}),
              EndsWith("no line for image 00002.png, number 2"));
}

TEST_F(TimesFile, OneTimeTooManyOrTooFewIsRefusedWhereOnlyThePlaceTells) {
  EXPECT_THAT(error("1.0\n", {"a.png", "b.png"}), EndsWith("1 times for 2 images"));
  EXPECT_THAT(error("1.0\n2.0\n3.0\n", {"a.png", "b.png"}), EndsWith("3 times for 2 images"));
}

TEST_F(TimesFile, MoreTimesThanImagesAreCounted) {
  const test::CapturedLog log;
  EXPECT_EQ(read("1.0 a.png\n2.0 b.png\n3.0 c.png\n", {"a.png", "b.png"}).size(), 2U);
  EXPECT_EQ(log.lines("times.txt has 3 times for 2 images; images are missing").size(), 1U);
}

TEST_F(TimesFile, TimesThatDoNotIncreaseAreRefusedWithTheirLine) {
  const auto* const why = "line 3: the time of b.png is not after that of a.png before it";
  EXPECT_THAT(error("#\n1.0\n1.0\n", {"a.png", "b.png"}), EndsWith(why));
  EXPECT_THAT(error("#\n2.0 a.png\n1.0 b.png\n", {"a.png", "b.png"}), EndsWith(why));
  EXPECT_THAT(error("1.0000000001\n1.0000000002\n", {"a.png", "b.png"}), HasSubstr("line 2"));
}

TEST_F(TimesFile, ALineThatCannotBeReadIsQuotedWithItsNumber) {
  EXPECT_THAT(error("1.0\nx\n", {"a.png", "b.png"}),
              EndsWith("line 2: 'x' is not a time in seconds"));
  EXPECT_THAT(error("0 1.0 0.1\n1 2.0 bright\n", {"a.png", "b.png"}),
              HasSubstr("line 2: 'bright'"));
  EXPECT_THAT(error("0 1.0 4294.967296\n", {"a.png"}), HasSubstr("line 1: '4294.967296'"));
  EXPECT_THAT(error("1.0 a.png\n2.0 7\n", {"a.png", "b.png"}),
              EndsWith("line 1: '1.0' is not the number of an image"));
}

TEST_F(TimesFile, ALineWithAnotherNumberOfFieldsIsRefused) {
  EXPECT_THAT(error("1.0 a.png\n2.0\n", {"a.png", "b.png"}), HasSubstr("line 2: 1 fields"));
  EXPECT_THAT(error("1 2 3 4\n", {"a.png"}), HasSubstr("line 1: 4 fields"));
}

TEST_F(TimesFile, TwoLinesForOneImageAreRefused) {
  EXPECT_THAT(error("1.0 a.png\n2.0 x/a.png\n", {"a.png"}),
              EndsWith("line 2: a.png is already on line 1"));
  EXPECT_THAT(error("7 1.0\n007 2.0\n", {"7.png"}), EndsWith("line 2: 7 is already on line 1"));
}

TEST_F(TimesFile, AnEmptyOrUnreadableFileIsRefused) {
  EXPECT_THAT(error("", {"a.png"}), EndsWith("the file has none"));
  EXPECT_THAT(error("# nothing\n\n", {"a.png"}), EndsWith("the file has none"));
  const auto read_folder = [&] { read_times_file(folder_.path(), {"a.png"}); };
  EXPECT_THAT(error_of(read_folder), EndsWith("Is a directory"));
  const auto read_nothing = [&] { read_times_file(folder_ / "none", {"a.png"}); };
  EXPECT_THAT(error_of(read_nothing), EndsWith("No such file or directory"));
}

}  // namespace
}  // namespace orbbuf
