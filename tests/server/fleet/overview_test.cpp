// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "server/fleet/fleet.hpp"
#include "server/fleet/fleet_keys.hpp"
#include "tests/server/fleet/fake_key_store.hpp"

namespace orbbuf::fleet {
namespace {

using nlohmann::json;

class OverviewTest : public testing::Test {
 protected:
  void put(const std::string& key, const std::string& value) {
    keys_.keys[key] = {key, value, ++keys_.revision};
  }
  void add_sessions(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      const SessionName name{fmt::format("r{:05}", i), "s"};
      put(name.owner_key(), to_text(SessionOwner{"a", "1", 1, {{"a", 1, {}}}}));
      wire::Position position;
      position[wire::kFrames] = i;
      put(name.position_key(), to_text(position));
    }
  }
  void ask(const std::string& from) {
    overview_.async_page(from, [this](const Result<std::string>& text) {
      answers_.push_back(text ? json::parse(text.value()) : json());
    });
  }
  json page(const std::string& from) {
    ask(from);
    store_.deliver_all();
    return answers_.back();
  }

  test::FakeKeys keys_;
  test::FakeKeyStore store_{keys_};
  Overview overview_{store_, {{"127.0.0.1", 2379}}};
  std::vector<json> answers_;
};

/// C3
TEST_F(OverviewTest, ManySessionsComeInPagesEachSessionOnce) {
  constexpr std::size_t kSessions = 2 * Overview::kPage + 1;
  add_sessions(kSessions);
  put("/orbbuf/server/a", to_text(ServerEntry{"a", "1", "a:7722", "", 5}));
  std::set<std::string> robots;
  std::string from;
  std::size_t pages = 0;
  do {
    const json now = page(from);
    EXPECT_EQ(now["servers"][0]["name"], "a");
    EXPECT_LE(now["sessions"].size(), Overview::kPage);
    for (const json& session : now["sessions"]) {
      EXPECT_TRUE(robots.insert(session["robot"]).second);
      EXPECT_EQ(fmt::format("r{:05}", session["next"].empty() ? 0 : session["next"][0].get<int>()),
                session["robot"]);
    }
    from = now.value("next", "");
    ++pages;
  } while (!from.empty());
  EXPECT_EQ(pages, 3U);
  EXPECT_EQ(robots.size(), kSessions);
}

TEST_F(OverviewTest, HoweverManyAskThePageIsReadOnce) {
  add_sessions(2);
  for (int i = 0; i < 30; ++i) ask("");
  EXPECT_EQ(store_.sent(), 1U);
  store_.deliver_all();
  ASSERT_EQ(answers_.size(), 30U);
  ask("no name of a session");
  EXPECT_EQ(store_.sent(), 0U);
  ASSERT_EQ(answers_.size(), 31U);
  EXPECT_EQ(answers_.back(), answers_.front());
  EXPECT_EQ(answers_.back()["sessions"].size(), 2U);
}

TEST_F(OverviewTest, WithoutAnAnswerItSaysSoAndAsksAgain) {
  ask("");
  ask("");
  store_.fail();
  EXPECT_EQ(answers_, (std::vector<json>{json(), json()}));
  EXPECT_TRUE(page("").contains("sessions"));
}

}  // namespace
}  // namespace orbbuf::fleet
