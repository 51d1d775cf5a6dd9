// SPDX-License-Identifier: Apache-2.0
#include "common/config_source.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/config.hpp"
#include "tests/common/config_fixture.hpp"

namespace orbbuf {
namespace {

using testing::MatchesRegex;

/// Files, overrides and unknown keys, as ConfigReader shows them.
class ConfigSource : public ConfigFixture {
 protected:
  /// What reject_unknown() says, when link.server, buffer.capacity and buffer.policy are known.
  std::string unknown(std::string_view content, const std::vector<std::string>& overrides = {}) {
    return error_of([&] {
      auto reader = read(content, overrides);
      reader.text("link.server", "");
      reader.integer("buffer.capacity", 30, 3, 1000);
      reader.text("buffer.policy", "");
      reader.reject_unknown();
    });
  }
  std::string override_text(const std::string& value) {
    return read("", {"t.k=" + value}).text("t.k", "unset");
  }
};

TEST_F(ConfigSource, FileThatCannotBeReadIsNamedWithTheReason) {
  EXPECT_EQ(error_of([&] { ConfigReader("/nonexistent/x.toml", {}); }),
            "cannot read /nonexistent/x.toml: No such file or directory");
  EXPECT_EQ(error_of([&] { ConfigReader("/", {}); }), "cannot read /: Is a directory");
}

TEST_F(ConfigSource, WithoutAFileThereAreOnlyOverridesAndDefaults) {
  const std::vector<std::string> overrides = {"t.k=4"};
  ConfigReader reader("", overrides);
  EXPECT_EQ(reader.integer("t.k", 1, 0, 9), 4);
  EXPECT_EQ(reader.integer("t.other", 1, 0, 9), 1);
  reader.reject_unknown();
}

TEST_F(ConfigSource, SyntaxErrorNamesItsLine) {
  const auto syntax = [&](std::string_view content) { return error_of([&] { read(content); }); };
  EXPECT_THAT(syntax("[t]\nk = 1\nk2 = = 3\n"), MatchesRegex("FILE:3: Error while parsing.*"));
  EXPECT_THAT(syntax("[t]\nk = 1\nk = 2\n"), MatchesRegex("FILE:3: Error while parsing.*"));
  EXPECT_THAT(syntax("[t]\n\nk = \"open\n"), MatchesRegex("FILE:3: Error while parsing.*"));
  EXPECT_THAT(syntax("k = '\xFF'\n"), MatchesRegex("FILE:1: .*"));
  EXPECT_THAT(syntax("k = fal\nse\n"), MatchesRegex("FILE:1: .*'fal.'.*")) << "on one line";
}

TEST_F(ConfigSource, OverrideWinsOverTheFileAndTheLastOverTheFirst) {
  auto reader = read("[t]\na = 1\nb = 1\n", {"t.a=2", "t.a=3"});
  EXPECT_EQ(reader.integer("t.a", 0, 0, 9), 3);
  EXPECT_EQ(reader.integer("t.b", 0, 0, 9), 1);
}

TEST_F(ConfigSource, OverrideIsTomlIfItCanBe) {
  auto reader = read("", {"t.i=-5", "t.n=1e3", "t.f=false", "t.s=\"5\"", "t.l='a b'"});
  EXPECT_EQ(reader.integer("t.i", 0, -9, 9), -5);
  EXPECT_EQ(reader.number("t.n", 0, 0, 9999), 1000);
  EXPECT_FALSE(reader.flag("t.f", true));
  EXPECT_EQ(reader.text("t.s", ""), "5");
  EXPECT_EQ(reader.text("t.l", ""), "a b");
}

TEST_F(ConfigSource, OverrideThatIsNotTomlIsAString) {
  for (const auto* value :
       {"10.0.0.1:7722", "[::1]:7722", "tb3-07", "", "250 ms", "/var/lib/x", "a=b", "1 # one",
        "1, w = 2", "1}\nx = {y = 2", "1}", "\"open", "1\n", "{", "x # \"y\""}) {
    EXPECT_EQ(override_text(value), value);
  }
}

TEST_F(ConfigSource, OverrideErrorNamesTheOverride) {
  EXPECT_EQ(error_of([&] { read("[t]\nk = 1\n", {"t.k=x"}).integer("t.k", 0, 0, 9); }),
            "--set t.k=x: t.k: expected an integer, got string \"x\"");
}

TEST_F(ConfigSource, OverrideNeedsAKeyAndAValue) {
  EXPECT_EQ(error_of([&] { read("", {"t.k"}); }), "--set t.k: expected KEY=VALUE");
  EXPECT_EQ(error_of([&] { read("", {"=5"}); }), "--set =5: the key is empty");
  EXPECT_EQ(error_of([&] { read("", {""}); }), "--set : expected KEY=VALUE");
}

TEST_F(ConfigSource, KnownKeysAreNotUnknown) {
  EXPECT_EQ(unknown("buffer.capacity = 30\n[link]\nserver = 'x'\n", {"buffer.policy=random"}), "");
}

TEST_F(ConfigSource, UnknownKeyNamesTheNearestOne) {
  EXPECT_EQ(unknown("[buffer]\npolicy = 'x'\ncapcity = 3\n"),
            "FILE:3: buffer.capcity: unknown key; did you mean 'buffer.capacity'?");
  EXPECT_EQ(unknown("[buffer]\nexposure = 3\n"), "FILE:2: buffer.exposure: unknown key");
  EXPECT_EQ(unknown("colour = 3\n"), "FILE:1: colour: unknown key");
}

TEST_F(ConfigSource, UnknownTableNamesTheNearestOne) {
  EXPECT_EQ(unknown("[link]\n[bufer]\ncapacity = 3\n"),
            "FILE:2: bufer: unknown table; did you mean 'buffer'?");
  EXPECT_EQ(unknown("[camera]\n"), "FILE:1: camera: unknown table");
  EXPECT_EQ(unknown("[buffer.orb]\nx = 1\n"), "FILE:1: buffer.orb: unknown table");
  EXPECT_EQ(unknown("[[camera]]\n"), "FILE:1: camera: unknown key");
}

TEST_F(ConfigSource, FirstUnknownKeyIsTheFirstInTheFile) {
  EXPECT_EQ(unknown("[z]\n[a]\n"), "FILE:1: z: unknown table");
  EXPECT_EQ(unknown("[link]\nzz = 1\naa = 2\n", {"x.y=1"}), "FILE:2: link.zz: unknown key");
}

TEST_F(ConfigSource, UnknownOverrideIsRefused) {
  EXPECT_EQ(unknown("", {"link.sever=x"}),
            "--set link.sever=x: link.sever: unknown key; did you mean 'link.server'?");
  EXPECT_EQ(unknown("", {"link=x"}), "--set link=x: link: unknown key");
}

TEST_F(ConfigSource, QuotedKeyWithADotIsNotThePath) {
  EXPECT_EQ(unknown("\"link.server\" = 'x'\n"),
            "FILE:1: \"link.server\": unknown key; did you mean 'link.server'?");
}

TEST_F(ConfigSource, ValueWhereATableIsNeededIsRefused) {
  EXPECT_EQ(unknown("link = 5\n"), "FILE:1: link: expected a table, got integer 5");
  EXPECT_EQ(unknown("[[buffer]]\n"), "FILE:1: buffer: expected a table, got an array");
}

const std::set<std::string> kWords = {"buffer.capacity", "buffer.policy", "link.server",
                                      "log.level"};

TEST(NearestWord, SlipFindsItsWord) {
  EXPECT_EQ(nearest_word("buffer.capcity", kWords), "buffer.capacity");  // one missing
  EXPECT_EQ(nearest_word("bufffer.policy", kWords), "buffer.policy");    // one too many
  EXPECT_EQ(nearest_word("link.sevrer", kWords), "link.server");         // two swapped
  EXPECT_EQ(nearest_word("lag.level", kWords), "log.level");             // one replaced
  EXPECT_EQ(nearest_word("log.level", kWords), "log.level");
}

TEST(NearestWord, FarWordFindsNothing) {
  EXPECT_EQ(nearest_word("camera.exposure", kWords), std::nullopt);
  EXPECT_EQ(nearest_word("", kWords), std::nullopt);
  EXPECT_EQ(nearest_word("log.level", {}), std::nullopt);
}

TEST(NearestWord, TwoLettersOfAShortWordAndAQuarterOfALongOneMayDiffer) {
  const std::set<std::string> words = {"abcd", "abcdefghijkl"};
  EXPECT_EQ(nearest_word("abxx", words), "abcd");
  EXPECT_EQ(nearest_word("axxx", words), std::nullopt);
  EXPECT_EQ(nearest_word("abcdefghixxx", words), "abcdefghijkl");
  EXPECT_EQ(nearest_word("abcdefghxxxx", words), std::nullopt);
}

}  // namespace
}  // namespace orbbuf
