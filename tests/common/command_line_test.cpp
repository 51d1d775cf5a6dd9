// SPDX-License-Identifier: Apache-2.0
#include "common/command_line.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

namespace orbbuf {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;

/// The exit status, if the program would end there; what is printed goes to output().
class CommandLineTest : public ::testing::Test {
 protected:
  std::optional<int> parse(CommandLine& line, std::vector<std::string> words) {
    words.insert(words.begin(), "program");
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    ::testing::internal::CaptureStdout();
    ::testing::internal::CaptureStderr();
    const auto status = line.parse(static_cast<int>(arguments.size()), arguments.data());
    output_ = ::testing::internal::GetCapturedStdout() + ::testing::internal::GetCapturedStderr();
    return status;
  }
  bool is_taken(CommandLine& line, const std::vector<std::string>& words) {
    return !parse(line, words);
  }
  bool is_refused(CommandLine& line, const std::vector<std::string>& words) {
    return parse(line, words).value_or(0) != 0;
  }
  const std::string& output() const { return output_; }

 private:
  std::string output_;
};

TEST_F(CommandLineTest, EachOptionIsWrittenToItsVariable) {
  std::string text = "default", untouched = "default";
  std::filesystem::path path;
  std::vector<std::string> list;
  std::size_t count = 0;
  double number = 0;
  bool is_given = false, is_called = false;
  CommandLine line("About");
  line.add_option("--text", text);
  line.add_option("--untouched", untouched);
  line.add_option("--path", path);
  line.add_option("--list", list);
  line.add_option("--count", count);
  line.add_option("--number", number);
  line.add_flag("--flag", is_given);
  line.add_flag("--call", [&] { is_called = true; });
  ASSERT_TRUE(is_taken(line, {"--text=a b", "--path", "/x", "--list", "1", "2", "--count", "3",
                              "--number", "0.5", "--flag", "--call"}));
  EXPECT_EQ(text, "a b");
  EXPECT_EQ(untouched, "default");
  EXPECT_EQ(path, "/x");
  EXPECT_THAT(list, ElementsAre("1", "2"));
  EXPECT_EQ(count, 3u);
  EXPECT_EQ(number, 0.5);
  EXPECT_TRUE(is_given);
  EXPECT_TRUE(is_called);
}

TEST_F(CommandLineTest, AListOneByOneLeavesTheNextWordToTheArguments) {
  std::vector<std::string> sets;
  std::string file;
  CommandLine line("About");
  line.add_option("--set", sets).one_by_one();
  line.add_option("FILE", file).required();
  ASSERT_TRUE(is_taken(line, {"--set", "a=1", "file", "--set", "b=2"}));
  EXPECT_THAT(sets, ElementsAre("a=1", "b=2"));
  EXPECT_EQ(file, "file");
}

TEST_F(CommandLineTest, WhatIsWrongEndsTheProgramAndIsNamed) {
  std::string word, needed;
  int number = 0;
  bool has_both = false;
  CommandLine line("About");
  line.add_option("--word", word).one_of({"one", "two"});
  line.add_option("--number", number).in_range(1, 9);
  line.add_option("--needed", needed).required();
  line.add_flag("--both", has_both).needs("--word");
  EXPECT_TRUE(is_refused(line, {}));
  EXPECT_THAT(output(), HasSubstr("--needed"));
  EXPECT_TRUE(is_refused(line, {"--needed=x", "--word=three"}));
  EXPECT_THAT(output(), AllOf(HasSubstr("--word"), HasSubstr("three")));
  for (const char* bad : {"--number=0", "--number=10", "--number=x"}) {
    EXPECT_TRUE(is_refused(line, {"--needed=x", bad})) << bad;
  }
  EXPECT_TRUE(is_refused(line, {"--needed=x", "--both"}));
  EXPECT_TRUE(is_refused(line, {"--needed=x", "--unknown"}));
  EXPECT_TRUE(is_taken(line, {"--needed=x", "--both", "--word=two", "--number=9"}));
}

TEST_F(CommandLineTest, HelpShowsValuesDefaultsAndTheFooter) {
  std::string file, word;
  int number = 7;
  CommandLine line("What it does", "program-name");
  line.add_option("--file", file, "to read").value_name("FILE");
  line.add_option("--number", number, "of frames").with_default();
  line.add_option("WORD", word, "to say").value_name("");
  line.add_version("program 1.2");
  line.add_footer("The last line.");
  EXPECT_EQ(parse(line, {"--help"}), 0);
  EXPECT_THAT(output(),
              AllOf(HasSubstr("What it does"), HasSubstr("program-name"), HasSubstr("--file FILE"),
                    HasSubstr("to read"), HasSubstr("=7"), EndsWith("The last line.\n")));
  EXPECT_EQ(parse(line, {"--version"}), 0);
  EXPECT_EQ(output(), "program 1.2\n");
}

TEST_F(CommandLineTest, OneSubcommandAtMostIsChosen) {
  std::vector<std::string> chosen;
  std::string of_second;
  CommandLine line("About");
  line.add_subcommand("first", "1", [&] { chosen.emplace_back("first"); });
  auto second = line.add_subcommand("second", "2", [&] { chosen.emplace_back("second"); });
  second.add_option("--option", of_second).required();
  EXPECT_TRUE(is_taken(line, {}));
  EXPECT_THAT(chosen, ElementsAre());
  EXPECT_TRUE(is_taken(line, {"second", "--option=x"}));
  EXPECT_THAT(chosen, ElementsAre("second"));
  EXPECT_EQ(of_second, "x");
  EXPECT_TRUE(is_refused(line, {"second"}));
  EXPECT_TRUE(is_refused(line, {"third"}));
  EXPECT_EQ(parse(line, {"--help"}), 0);
  EXPECT_THAT(output(), AllOf(HasSubstr("first"), HasSubstr("second"), Not(HasSubstr("--option"))));
}

}  // namespace
}  // namespace orbbuf
