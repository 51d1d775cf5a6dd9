// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/etcd_client.hpp"

#include <gmock/gmock.h>

#include <thread>

#include "testing/real_etcd.hpp"
#include "tests/server/event_loop.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// A client of a real etcd.
class EtcdClientTest : public test::EventLoop {
 protected:
  void SetUp() override {
    if (!test::RealEtcd::is_installed()) GTEST_SKIP() << "etcd is not installed (etcd-server)";
    etcd_.emplace();
    make({*parse(etcd_->endpoint())});
  }
  void TearDown() override {
    if (!client_) return;
    client_->stop();
    run_ready();
  }
  static std::optional<Address> parse(const std::string& text) {
    const auto address = parse_address(text);
    return address ? std::optional(address.value()) : std::nullopt;
  }
  void make(std::vector<Address> endpoints) {
    EtcdChannel::Options options{std::move(endpoints), {}, {}, {}};
    options.attempt = std::chrono::seconds(20);  // the machine may be busy
    options.patience = std::chrono::seconds(60);
    client_ = std::make_unique<EtcdClient>(main_, std::move(options));
  }

  template <class T, class Begin>
  Result<T> await(Begin begin) {
    std::optional<Result<T>> result;
    begin([&](Result<T> answer) { result = std::move(answer); });
    EXPECT_TRUE(run_until([&] { return result.has_value(); }));
    return result ? std::move(*result) : Result<T>(Error{"no answer"});
  }
  Result<std::vector<KeyTxnOutcome>> txns(std::vector<KeyTxn> all) {
    return await<std::vector<KeyTxnOutcome>>(
        [&](auto done) { client_->async_txns(std::move(all), done); });
  }
  KeyTxnOutcome txn(KeyTxn one) {
    const auto outcomes = txns({std::move(one)});
    EXPECT_TRUE(outcomes) << outcomes.error().text;
    return outcomes ? outcomes.value().at(0) : KeyTxnOutcome{};
  }
  std::vector<KeyValue> range(const std::string& prefix) {
    const auto found = await<std::vector<KeyValue>>(
        [&](auto done) { client_->async_range(KeyRange(prefix), done); });
    EXPECT_TRUE(found) << found.error().text;
    return found ? found.value() : std::vector<KeyValue>();
  }

  std::optional<test::RealEtcd> etcd_;
  std::unique_ptr<EtcdClient> client_;
};

TEST_F(EtcdClientTest, ATxnIsDoneIfItsKeysHaveTheRevisions) {
  const auto first = txn({{{"/a/1", 0}}, {{"/a/1", "x"}}, {"/a/1", "/a/2"}});
  EXPECT_TRUE(first.is_done);
  EXPECT_THAT(first.found, ElementsAre(KeyValue{"/a/1", "x", first.revision}));
  const auto second = txn({{{"/a/1", 0}}, {{"/a/1", "y"}}, {"/a/1"}});
  EXPECT_FALSE(second.is_done);
  EXPECT_THAT(second.found, ElementsAre(KeyValue{"/a/1", "x", first.revision}));
  const auto third = txn({{{"/a/1", first.revision}}, {{"/a/1", "z"}}, {}});
  EXPECT_TRUE(third.is_done);
  EXPECT_THAT(range("/a/"), ElementsAre(KeyValue{"/a/1", "z", third.revision}));
}

TEST_F(EtcdClientTest, ATxnIsDoneIfItsKeyHasTheValue) {
  EXPECT_FALSE(txn({{{"/a/1", 0, ""}}, {{"/a/1", "x"}}, {}}).is_done) << "it is not there";
  EXPECT_TRUE(txn({{{"/a/1", 0}}, {{"/a/1", "x"}}, {}}).is_done);
  const auto refused = txn({{{"/a/1", 0, "y"}}, {{"/a/1", "z"}}, {}, {"/a/1"}});
  EXPECT_FALSE(refused.is_done);
  ASSERT_NE(refused.find("/a/1"), nullptr);
  EXPECT_EQ(refused.find("/a/1")->value, "x");
  EXPECT_TRUE(txn({{{"/a/1", 0, "x"}}, {{"/a/1", "y"}}, {}}).is_done);
}

TEST_F(EtcdClientTest, EachOfSeveralTxnsStandsForItself) {
  const auto outcomes = txns({{{{"/a", 0}}, {{"/a", "1"}}, {}},
                              {{{"/b", 99}}, {{"/b", "2"}}, {}},
                              {{{"/c", 0}}, {{"/c", std::string("\0\xff", 2)}}, {}}});
  ASSERT_TRUE(outcomes) << outcomes.error().text;
  const auto& all = outcomes.value();
  EXPECT_EQ((std::vector{all[0].is_done, all[1].is_done, all[2].is_done}),
            (std::vector{true, false, true}));
  EXPECT_THAT(range("/"), ElementsAre(KeyValue{"/a", "1", all[0].revision},
                                      KeyValue{"/c", std::string("\0\xff", 2), all[2].revision}));
}

TEST_F(EtcdClientTest, CallsThatComeWhileARequestIsOutstandingShareTheNext) {
  std::vector<Result<std::vector<KeyTxnOutcome>>> answers;
  const auto put = [&](std::vector<std::string> keys) {
    std::vector<KeyTxn> all;
    for (const std::string& key : keys) all.push_back({{{key, 0}}, {{key, "v"}}, {}});
    client_->async_txns(std::move(all), [&](auto answer) { answers.push_back(std::move(answer)); });
  };
  put({"/1"});
  ASSERT_TRUE(run_until([&] { return client_->channel().requests() == 1; }));
  put({"/2", "/3"});
  put({"/1"});  // is there already
  ASSERT_TRUE(run_until([&] { return answers.size() == 3; }));
  EXPECT_EQ(client_->channel().requests(), 2U);
  for (const auto& answer : answers) ASSERT_TRUE(answer) << answer.error().text;
  EXPECT_EQ(answers[1].value().size(), 2U);
  EXPECT_TRUE(answers[1].value()[1].is_done);
  EXPECT_FALSE(answers[2].value().at(0).is_done);
}

TEST_F(EtcdClientTest, CallsThatPutTheSameKeyDoNotShareARequest) {
  int done = 0;
  for (int i = 0; i < 3; ++i) {
    client_->async_txns({{{}, {{"/x", std::to_string(i)}}, {}}},
                        [&](const auto& answer) { done += answer ? 1 : 0; });
  }
  ASSERT_TRUE(run_until([&] { return done == 3; }));
  EXPECT_EQ(range("/x").at(0).value, "2");
}

TEST_F(EtcdClientTest, TheMostTxnsThatARequestMayHave) {
  std::vector<KeyTxn> all;
  for (std::size_t i = 0; i < KeyStore::kMostTxns; ++i) {
    const std::string key = "/most/" + std::to_string(i);
    all.push_back({{{key, 0}}, {{key, "v"}}, {}});
  }
  const auto outcomes = txns(std::move(all));
  ASSERT_TRUE(outcomes) << outcomes.error().text;
  EXPECT_EQ(range("/most/").size(), KeyStore::kMostTxns);
}

TEST_F(EtcdClientTest, KeysGoWithTheirLease) {
  const auto lease =
      await<std::int64_t>([&](auto done) { client_->async_grant(std::chrono::seconds(60), done); });
  ASSERT_TRUE(lease) << lease.error().text;
  txn({{}, {{"/l", "x", lease.value()}}, {}});
  const auto keep = [&] {
    return await<bool>([&](auto done) { client_->async_keep_alive(lease.value(), done); });
  };
  EXPECT_TRUE(keep().value());
  EXPECT_TRUE(await<bool>([&](auto done) { client_->async_revoke(lease.value(), done); }));
  EXPECT_THAT(range("/l"), IsEmpty());
  EXPECT_FALSE(keep().value());
}

TEST_F(EtcdClientTest, KeysGoWhenTheirLeaseIsNotKeptAlive) {
  const auto lease =
      await<std::int64_t>([&](auto done) { client_->async_grant(std::chrono::seconds(1), done); });
  ASSERT_TRUE(lease) << lease.error().text;
  const auto put = txn({{}, {{"/l", "x", lease.value()}}, {}});
  EXPECT_THAT(range("/l"), ElementsAre(KeyValue{"/l", "x", put.revision}));
  while (!range("/l").empty()) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_FALSE(
      await<bool>([&](auto done) { client_->async_keep_alive(lease.value(), done); }).value());
  EXPECT_EQ(txn({}).revision, put.revision + 1);
}

TEST_F(EtcdClientTest, AKeyWithoutItsLeaseStays) {
  const auto lease =
      await<std::int64_t>([&](auto done) { client_->async_grant(std::chrono::seconds(60), done); });
  ASSERT_TRUE(lease) << lease.error().text;
  txn({{}, {{"/l", "x", lease.value()}}, {}});
  txn({{}, {{"/l", "y"}}, {}});
  EXPECT_TRUE(await<bool>([&](auto done) { client_->async_revoke(lease.value(), done); }));
  EXPECT_EQ(range("/l").at(0).value, "y");
  const auto refused = txns({{{}, {{"/m", "x", lease.value()}}, {}}});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().text, HasSubstr("requested lease not found"));
}

TEST_F(EtcdClientTest, TheChangesOfARequestHaveOneRevision) {
  const auto first = txn({{}, {{"/a", "1"}, {"/b", "1"}}, {}});
  EXPECT_THAT(range("/"), ElementsAre(KeyValue{"/a", "1", first.revision},
                                      KeyValue{"/b", "1", first.revision}));
  EXPECT_EQ(txn({{{"/a", 99}}, {{"/a", "2"}}, {}}).revision, first.revision);
  EXPECT_EQ(txn({{}, {{"/a", "3"}}, {}}).revision, first.revision + 1);
}

TEST_F(EtcdClientTest, AllComparisonsOfARequestAreMadeBeforeItsChanges) {
  const auto outcomes = txns({{{}, {{"/a", "1"}}, {}}, {{{"/a", 0}}, {{"/b", "1"}}, {"/a"}}});
  ASSERT_TRUE(outcomes) << outcomes.error().text;
  EXPECT_TRUE(outcomes.value()[1].is_done);
  EXPECT_NE(outcomes.value()[1].find("/a"), nullptr);
}

TEST_F(EtcdClientTest, ARangeIsInOrderAndMayBeginLaterAndEndSooner) {
  for (const std::string key : {"/r/b", "/r/\xff", "/r/a", "/r/c", "/s"})
    txn({{}, {{key, ""}}, {}});
  const auto keys = [this](KeyRange which) {
    const auto found = await<std::vector<KeyValue>>(
        [&](auto done) { client_->async_range(std::move(which), done); });
    std::vector<std::string> names;
    for (const KeyValue& key : found.value()) names.push_back(key.key);
    return names;
  };
  EXPECT_THAT(keys(KeyRange("/r/")), ElementsAre("/r/a", "/r/b", "/r/c", "/r/\xff"));
  EXPECT_THAT(keys(KeyRange("/r/", "b", 2)), ElementsAre("/r/b", "/r/c"));
}

TEST_F(EtcdClientTest, AnEtcdThatIsStartedAgainHasWhatItHad) {
  const auto lease =
      await<std::int64_t>([&](auto done) { client_->async_grant(std::chrono::seconds(60), done); });
  ASSERT_TRUE(lease) << lease.error().text;
  const auto put = txn({{}, {{"/a", "1", lease.value()}, {"/b", "2"}}, {}});
  etcd_->kill();
  etcd_->start();
  EXPECT_THAT(range("/"),
              ElementsAre(KeyValue{"/a", "1", put.revision}, KeyValue{"/b", "2", put.revision}));
  EXPECT_TRUE(
      await<bool>([&](auto done) { client_->async_keep_alive(lease.value(), done); }).value());
  EXPECT_TRUE(await<bool>([&](auto done) { client_->async_revoke(lease.value(), done); }));
  EXPECT_THAT(range("/"), ElementsAre(KeyValue{"/b", "2", put.revision}));
}

TEST_F(EtcdClientTest, TheNextEndpointIsAskedWhenOneDoesNotAnswer) {
  make({*parse("127.0.0.1:" + std::to_string(test::free_ports(1)[0])), *parse(etcd_->endpoint())});
  EXPECT_TRUE(txn({{}, {{"/x", "1"}}, {}}).is_done);
  EXPECT_EQ(client_->channel().failures(), 1U);
  EXPECT_TRUE(txn({{}, {{"/x", "2"}}, {}}).is_done);
  EXPECT_EQ(client_->channel().failures(), 1U);  // the one that answers is kept
}

TEST_F(EtcdClientTest, ARequestOfAnEtcdThatIsStartedAgainIsAnswered) {
  EXPECT_TRUE(txn({{}, {{"/x", "1"}}, {}}).is_done);
  etcd_->kill();
  etcd_->start();
  EXPECT_TRUE(txn({{}, {{"/x", "2"}}, {}}).is_done);
}

TEST_F(EtcdClientTest, AnEtcdThatStandsStillCostsThePatienceAndNoMore) {
  EtcdChannel::Options options{{*parse(etcd_->endpoint())}, {}, {}, {}};
  options.attempt = std::chrono::milliseconds(50);
  options.patience = std::chrono::milliseconds(400);
  client_ = std::make_unique<EtcdClient>(main_, std::move(options));
  etcd_->pause();
  const auto outcomes = txns({{{}, {{"/x", "1"}}, {}}});
  etcd_->resume();
  ASSERT_FALSE(outcomes);
  EXPECT_THAT(outcomes.error().text, HasSubstr("no answer"));
}

/// Timer and answer are then handled in one go, in either order.
TEST_F(EtcdClientTest, NothingFailsBehindAnAnswerThatComesWithTheEndOfItsTime) {
  EtcdChannel::Options options{{*parse(etcd_->endpoint())}, {}, {}, {}};
  options.attempt = std::chrono::milliseconds(300);
  options.patience = std::chrono::seconds(60);
  const auto attempt = options.attempt;
  client_ = std::make_unique<EtcdClient>(main_, std::move(options));
  txn({{}, {{"/x", "1"}}, {}});  // it is connected
  for (int steps = 0; steps < 6; ++steps) {
    std::optional<std::uint64_t> failures;  // before the answer
    client_->async_range(KeyRange("/x"),
                         [&](const auto&) { failures = client_->channel().failures(); });
    run_ready();
    for (int i = 0; i < steps && !failures; ++i) main_.run_one();
    std::this_thread::sleep_for(attempt);  // `main` stands still
    ASSERT_TRUE(run_until([&] { return failures.has_value(); }));
    run_ready();
    EXPECT_EQ(client_->channel().failures(), *failures) << "after " << steps << " steps";
  }
}

TEST_F(EtcdClientTest, WhatEtcdRefusesIsNotTriedAgain) {
  const auto outcomes = txns({{{}, {{"/x", "1"}}, {}}, {{}, {{"/x", "2"}}, {}}});  // one key twice
  ASSERT_FALSE(outcomes);
  EXPECT_THAT(outcomes.error().text, HasSubstr("duplicate key"));
  EXPECT_EQ(client_->channel().failures(), 0U);
}

TEST_F(EtcdClientTest, WhatWaitsWhenTheClientStopsFails) {
  int failed = 0;
  for (int i = 0; i < 2; ++i) {
    client_->async_range(KeyRange("/"), [&](const auto& found) { failed += found ? 0 : 1; });
  }
  client_->stop();
  client_->async_range(KeyRange("/"), [&](const auto& found) { failed += found ? 0 : 1; });
  EXPECT_TRUE(run_until([&] { return failed == 3; }));
}

}  // namespace
}  // namespace orbbuf
