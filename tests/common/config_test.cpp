// SPDX-License-Identifier: Apache-2.0
#include "common/config.hpp"

#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <map>

#include "tests/common/config_fixture.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;
using std::chrono::nanoseconds;

class Config : public ConfigFixture {
 protected:
  /// Each reads key t.k from a file whose second line is `line`; the error's text if it throws.
  std::string text(std::string_view line) {
    return error_with(line, [](ConfigReader& reader) { reader.text("t.k", ""); });
  }
  std::string flag(std::string_view line) {
    return error_with(line, [](ConfigReader& reader) { reader.flag("t.k", false); });
  }
  std::string integer(std::string_view line) {
    return error_with(line, [](ConfigReader& reader) { reader.integer("t.k", 1, -5, 65535); });
  }
  std::string number(std::string_view line) {
    return error_with(line, [](ConfigReader& reader) { reader.number("t.k", 1, 0.5, 100); });
  }
  std::string duration(std::string_view line) {
    return error_with(line, [](ConfigReader& reader) { reader.duration("t.k", 1s, 10ms, 1h); });
  }
  std::string bytes(std::string_view line) {
    return error_with(line, [](ConfigReader& reader) { reader.bytes("t.k", 1, 1024, 1 << 20); });
  }
  std::string choice(std::string_view line) {
    return error_with(line, [](ConfigReader& reader) { reader.choice("t.k", "a", kPolicies); });
  }

  static constexpr std::array<std::string_view, 3> kPolicies = {"orbbuf", "random", "uniform"};
};

TEST_F(Config, ValuesAreReadByTheirTypes) {
  auto reader = read(
      "[a]\n"
      "text = 'hello'\nflag = true\ninteger = -3\nnumber = 2.5\nwhole = 4\n"
      "[b]\n"
      "duration = '1.5 s'\nbytes = '16 KiB'\nchoice = 'random'\n"
      "[c.d]\ndeep = 'yes'\n");
  EXPECT_EQ(reader.text("a.text", ""), "hello");
  EXPECT_TRUE(reader.flag("a.flag", false));
  EXPECT_EQ(reader.integer("a.integer", 0, -5, 5), -3);
  EXPECT_EQ(reader.number("a.number", 0, 0, 5), 2.5);
  EXPECT_EQ(reader.number("a.whole", 0, 0, 5), 4);
  EXPECT_EQ(reader.duration("b.duration", 1s, 0s, 1h), 1500ms);
  EXPECT_EQ(reader.bytes("b.bytes", 1, 0, 1 << 20), 16384U);
  EXPECT_EQ(reader.choice("b.choice", "orbbuf", kPolicies), "random");
  EXPECT_EQ(reader.text("c.d.deep", ""), "yes");
  reader.reject_unknown();
}

TEST_F(Config, ListsAreOfStrings) {
  using Texts = std::vector<std::string>;
  EXPECT_EQ(read("[t]\nk = ['a', 'b']\n").texts("t.k"), (Texts{"a", "b"}));
  EXPECT_EQ(read("[t]\n").texts("t.k"), Texts());
  EXPECT_EQ(read("[t]\nk = ['a']\n", {"t.k=c"}).texts("t.k"), Texts{"c"});
  EXPECT_EQ(read("", {"t.k=['c', 'd']"}).texts("t.k"), (Texts{"c", "d"}));
  const auto texts = [](ConfigReader& reader) { reader.texts("t.k"); };
  EXPECT_EQ(error_with("k = 'a'", texts),
            "FILE:2: t.k: expected an array of strings, got string \"a\"");
  EXPECT_EQ(error_with("k = ['a', 1]", texts),
            "FILE:2: t.k: expected an array of strings, got integer 1");
}

TEST_F(Config, OneOrMoreAreAStringOrAList) {
  using Texts = std::vector<std::string>;
  const auto got = [](ConfigReader& reader) { return reader.one_or_more_texts("t.k", {"x"}); };
  const auto of = [&](auto&&... words) {
    auto reader = read(words...);
    return got(reader);
  };
  EXPECT_EQ(of("[t]\n"), Texts{"x"});
  EXPECT_EQ(of("[t]\nk = 'a'\n"), Texts{"a"});
  EXPECT_EQ(of("[t]\nk = ['a', 'b']\n"), (Texts{"a", "b"}));
  EXPECT_EQ(of("[t]\nk = []\n"), Texts());
  EXPECT_EQ(of("", std::vector<std::string>{"t.k=[::1]:9"}), Texts{"[::1]:9"});
  EXPECT_EQ(of("", std::vector<std::string>{"t.k=['c', 'd']"}), (Texts{"c", "d"}));
  EXPECT_EQ(error_with("k = 1", got),
            "FILE:2: t.k: expected a string or an array of strings, got integer 1");
  EXPECT_EQ(error_with("k = ['a', 1]", got),
            "FILE:2: t.k: expected a string or an array of strings, got integer 1");
}

TEST_F(Config, WhatIsNotSetHasItsDefault) {
  auto reader = read("[t]\n");
  EXPECT_EQ(reader.text("t.text", "default"), "default");
  EXPECT_TRUE(reader.flag("t.flag", true));
  EXPECT_EQ(reader.integer("t.integer", 7, 0, 9), 7);
  EXPECT_EQ(reader.number("t.number", 0.5, 0, 1), 0.5);
  EXPECT_EQ(reader.duration("t.duration", 3s, 0s, 5s), 3s);
  EXPECT_EQ(reader.bytes("t.bytes", 512, 0, 1024), 512U);
  EXPECT_EQ(reader.choice("t.choice", "orbbuf", kPolicies), "orbbuf");
  EXPECT_EQ(reader.path("t.path", "/var/lib"), "/var/lib");
  EXPECT_EQ(reader.text("other.text", "default"), "default");
  reader.reject_unknown();
}

TEST_F(Config, LimitsAreAllowedThemselves) {
  EXPECT_EQ(integer("k = -5"), "");
  EXPECT_EQ(integer("k = 65535"), "");
  EXPECT_EQ(number("k = 0.5"), "");
  EXPECT_EQ(number("k = 100"), "");
  EXPECT_EQ(duration("k = '10 ms'"), "");
  EXPECT_EQ(duration("k = '60 min'"), "");
  EXPECT_EQ(bytes("k = '1 KiB'"), "");
  EXPECT_EQ(bytes("k = '1 MiB'"), "");
}

TEST_F(Config, WrongTypeNamesValueAndWhatWasExpected) {
  EXPECT_EQ(text("k = 5"), "FILE:2: t.k: expected a string, got integer 5");
  EXPECT_EQ(flag("k = 'true'"), "FILE:2: t.k: expected true or false, got string \"true\"");
  EXPECT_EQ(integer("k = 1.5"), "FILE:2: t.k: expected an integer, got number 1.5");
  EXPECT_EQ(integer("k = '1'"), "FILE:2: t.k: expected an integer, got string \"1\"");
  EXPECT_EQ(number("k = true"), "FILE:2: t.k: expected a number, got boolean true");
  EXPECT_EQ(duration("k = 5"),
            "FILE:2: t.k: expected a duration such as \"500 ms\", got integer 5");
  EXPECT_EQ(bytes("k = 4096"), "FILE:2: t.k: expected a size such as \"16 KiB\", got integer 4096");
  EXPECT_EQ(choice("k = 1"), "FILE:2: t.k: expected one of orbbuf, random, uniform, got integer 1");
  EXPECT_EQ(text("k = [1]"), "FILE:2: t.k: expected a string, got an array");
  EXPECT_EQ(text("k = { x = 1 }"), "FILE:2: t.k: expected a string, got a table");
  EXPECT_EQ(text("k = 2020-10-24"), "FILE:2: t.k: expected a string, got a date or time");
  EXPECT_EQ(integer("[t.k]"), "FILE:2: t.k: expected an integer, got a table");
}

TEST_F(Config, ValueOutOfItsRangeNamesTheRange) {
  EXPECT_EQ(integer("k = -6"), "FILE:2: t.k: must be between -5 and 65535, got -6");
  EXPECT_EQ(integer("k = 65536"), "FILE:2: t.k: must be between -5 and 65535, got 65536");
  EXPECT_EQ(number("k = 0.25"), "FILE:2: t.k: must be between 0.5 and 100, got 0.25");
  EXPECT_EQ(number("k = nan"), "FILE:2: t.k: must be between 0.5 and 100, got nan");
  EXPECT_EQ(number("k = inf"), "FILE:2: t.k: must be between 0.5 and 100, got inf");
  EXPECT_EQ(number("k = -inf"), "FILE:2: t.k: must be between 0.5 and 100, got -inf");
  EXPECT_EQ(duration("k = '9.9 ms'"), "FILE:2: t.k: must be between 10 ms and 1 h, got \"9.9 ms\"");
  EXPECT_EQ(duration("k = '-1 s'"), "FILE:2: t.k: must be between 10 ms and 1 h, got \"-1 s\"");
  EXPECT_EQ(bytes("k = '1023 B'"), "FILE:2: t.k: must be between 1 KiB and 1 MiB, got \"1023 B\"");
}

TEST_F(Config, NoNumberIsLargeEnoughToBeInfinite) {
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(
      error_with("k = inf", [&](ConfigReader& reader) { reader.number("t.k", 0, 0, infinity); }),
      "FILE:2: t.k: must be between 0 and inf, got inf");
}

TEST_F(Config, WhatIsNoQuantityIsRefused) {
  EXPECT_EQ(duration("k = '5 parsecs'"),
            "FILE:2: t.k: expected a duration such as \"500 ms\", got string \"5 parsecs\"");
  EXPECT_EQ(duration("k = '9999999999 h'"),
            "FILE:2: t.k: expected a duration such as \"500 ms\", got string \"9999999999 h\"");
  EXPECT_EQ(bytes("k = '-1 B'"),
            "FILE:2: t.k: expected a size such as \"16 KiB\", got string \"-1 B\"");
}

TEST_F(Config, WrongChoiceListsThemAll) {
  EXPECT_EQ(choice("k = 'newest'"),
            "FILE:2: t.k: expected one of orbbuf, random, uniform, got string \"newest\"");
}

TEST_F(Config, IntegerTooLargeForTomlIsASyntaxError) {
  EXPECT_TRUE(integer("k = 9223372036854775808").starts_with("FILE:2: "));
}

TEST_F(Config, ErrorStaysOnOneLine) {
  EXPECT_EQ(integer("k = \"a\\nb\\u001B\""),
            "FILE:2: t.k: expected an integer, got string \"a?b?\"");
}

TEST_F(Config, RelativePathIsTakenFromTheFoldersOfTheFile) {
  auto reader = read("[t]\nrelative = 'x/y'\nabsolute = '/x/y'\nempty = ''\n", {"t.given=x/y"});
  EXPECT_EQ(reader.path("t.relative", ""), file().parent_path() / "x/y");
  EXPECT_EQ(reader.path("t.absolute", ""), "/x/y");
  EXPECT_EQ(reader.path("t.empty", "z"), "");
  EXPECT_EQ(reader.path("t.given", ""), "x/y");
  EXPECT_EQ(reader.path("t.unset", "z"), "z");
}

TEST_F(Config, ANumberOnTheCommandLineIsATextWhereThatIsExpected) {
  auto reader = read("", {"t.id=5", "t.zeros=007"});
  EXPECT_EQ(reader.text("t.id", ""), "5");
  EXPECT_EQ(reader.text("t.zeros", ""), "007");
}

TEST_F(Config, ATableOfNumbersHasTheNamesThatAreSet) {
  using Numbers = std::map<std::string, double>;
  auto reader = read("[a]\nt = { gain = 3, auto = true, hue = -1, gamma = 2.2 }\nnone = {}\n",
                     {"a.t.gain=5", "a.t.zoom=7"});
  EXPECT_EQ(reader.numbers("a.t"),
            (Numbers{{"auto", 1}, {"gain", 5}, {"gamma", 2.2}, {"hue", -1}, {"zoom", 7}}));
  EXPECT_EQ(reader.numbers("a.none"), Numbers());
  EXPECT_EQ(reader.numbers("a.unset"), Numbers());
  reader.reject_unknown();
}

TEST_F(Config, WhatIsNoTableOfNumbersIsRefused) {
  const auto numbers = [](ConfigReader& reader) { reader.numbers("t.k"); };
  EXPECT_EQ(error_with("k = 3", numbers),
            "FILE:2: t.k: expected a table in the file, got integer 3");
  EXPECT_EQ(error_with("k = { x = nan }", numbers),
            "FILE:2: t.k.x: expected a number, got number nan");
  EXPECT_EQ(error_with("[t.k]", numbers, {"t.k.x=high"}),
            "--set t.k.x=high: t.k.x: expected a number, got string \"high\"");
  EXPECT_EQ(error_with("", numbers, {"t.k={x = 1}"}),
            "--set t.k={x = 1}: t.k: expected a table in the file, got a table");
}

TEST_F(Config, TablesHaveTheNamesThatAreSetAndTheKeysToAskWith) {
  using Tables = std::map<std::string, std::string>;
  auto reader = read("[a.one.x]\nk = 1\n[a.\"t.w.o\"]\nk = 2\n",
                     {"a.three.x.k=3", "a.\"f.our\".k=4", "a.one.x.j=5"});
  EXPECT_EQ(reader.tables("a"), (Tables{{"one", "a.one"},
                                        {"t.w.o", "a.\"t.w.o\""},
                                        {"three", "a.three"},
                                        {"f.our", "a.\"f.our\""}}));
  EXPECT_EQ(reader.tables("none"), Tables());
  EXPECT_TRUE(reader.has("a.one.x.k"));
  EXPECT_TRUE(reader.has("a.one.x.j"));
  EXPECT_FALSE(reader.has("a.one.x.i"));
  const auto number = [&](std::string_view key) { return reader.integer(key, 0, 0, 9); };
  EXPECT_EQ(number("a.one.x.k"), 1);
  EXPECT_EQ(number("a.\"t.w.o\".k"), 2);
  EXPECT_EQ(number("a.three.x.k"), 3);
  EXPECT_EQ(number("a.\"f.our\".k"), 4);
  EXPECT_EQ(number("a.one.x.j"), 5);
  reader.reject_unknown();
}

TEST_F(Config, FailNamesWhereTheValueWasSet) {
  const auto fail = [](std::string_view key) {
    return [key](const ConfigReader& reader) { reader.fail(key, "no such camera"); };
  };
  EXPECT_EQ(error_with("k = 1", fail("t.k")), "FILE:2: t.k: no such camera");
  EXPECT_EQ(error_with("k = 1", fail("t.other")), "FILE: t.other: no such camera");
  EXPECT_EQ(error_with("k = 1", fail("t.k"), {"t.k=2"}), "--set t.k=2: t.k: no such camera");
  EXPECT_EQ(error_of([&] { ConfigReader("", {}).fail("t.k", "no such camera"); }),
            "t.k: no such camera");
}

}  // namespace
}  // namespace orbbuf
