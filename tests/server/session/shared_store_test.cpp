// SPDX-License-Identifier: Apache-2.0
#include "server/session/shared_store.hpp"

#include <boost/asio/strand.hpp>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "server/session/session_reader.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::plain_frame;

class SharedStoreTest : public test::EventLoop {
 protected:
  std::shared_ptr<SharedStore> store(Durability durability = Durability::kAck) {
    return std::make_shared<SharedStore>(main_, strand_, parent_.path(), SessionInfo{"r", "s", ""},
                                         durability, &group_);
  }
  Result<Sequence> try_to_deliver(SharedStore& store, Sequence number) {
    std::optional<Result<Sequence>> answer;
    store.run(
        [number](SessionStore& session) -> Result<Sequence> {
          if (auto error = session.write(plain_frame(number), 0)) return std::move(*error);
          return session.position()[wire::kFrames];
        },
        [&](Result<Sequence> next) { answer.emplace(std::move(next)); });
    EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
    return answer.value_or(Error{"no answer"});
  }
  /// Returns the next number.
  Sequence deliver(SharedStore& store, Sequence number) {
    const auto next = try_to_deliver(store, number);
    EXPECT_TRUE(next);
    return next ? next.value() : 0;
  }
  void close(SharedStore& store) {
    bool is_closed = false;
    store.close([&] { is_closed = true; });
    EXPECT_TRUE(run_until([&] { return is_closed; }));
  }
  /// The kept mark of the newest record.
  journal::Place kept() const {
    RecordReader reader(folder_);
    journal::Place kept;
    while (const auto entry = reader.next().value()) kept = entry->record.kept;
    return kept;
  }

  test::TemporaryFolder parent_;
  const fs::path folder_ = parent_ / "r/s";
  PoolStrand strand_ = boost::asio::make_strand(files_);
  std::vector<std::optional<Error>> sync_results_;  // of the syncs to come; none: all is well
  GroupCommit group_{main_,
                     [this]() -> std::optional<Error> {
                       if (sync_results_.empty()) return std::nullopt;
                       auto result = std::move(sync_results_.front());
                       sync_results_.erase(sync_results_.begin());
                       return result;
                     },
                     std::chrono::milliseconds(1), "the test fails"};
};

TEST_F(SharedStoreTest, IsOpenedByTheFirstWorkAndAgainAfterItWasClosed) {
  const auto store = this->store();
  EXPECT_FALSE(fs::exists(folder_));
  EXPECT_EQ(deliver(*store, 0), 1U);
  close(*store);
  EXPECT_TRUE(fs::exists(folder_ / "checksums.sfv"));
  EXPECT_EQ(deliver(*store, 1), 2U);
}

TEST_F(SharedStoreTest, ASessionThatCannotBeOpenedIsTheAnswer) {
  fs::create_directories(folder_ / "journal.000000");
  const auto store = this->store();
  EXPECT_FALSE(try_to_deliver(*store, 0));
  fs::remove(folder_ / "journal.000000");
  EXPECT_EQ(deliver(*store, 0), 1U);
}

TEST_F(SharedStoreTest, WorkAndClosingAreDoneInTurn) {
  const auto store = this->store();
  std::vector<int> order;
  const auto work = [](SessionStore& session) -> Result<bool> { return session.is_new(); };
  store->run(work, [&](const Result<bool>&) { order.push_back(1); });
  store->close([&] { order.push_back(2); });
  store->run(work, [&](const Result<bool>&) { order.push_back(3); });
  ASSERT_TRUE(run_until([&] { return order.size() == 3; }));
  EXPECT_EQ(order, (std::vector<int>{1, 2, 3}));
}

TEST_F(SharedStoreTest, AnAcknowledgementWaitsForTheDeviceWithAck) {
  const auto store = this->store();
  deliver(*store, 0);
  const auto written = read_summary(folder_);
  std::optional<std::optional<Error>> committed;
  store->async_commit([&](std::optional<Error> error) { committed = std::move(error); });
  EXPECT_FALSE(committed);
  ASSERT_TRUE(run_until([&] { return committed.has_value(); }));
  EXPECT_FALSE(*committed);
  deliver(*store, 1);
  EXPECT_GT(kept(), journal::Place{});
}

TEST_F(SharedStoreTest, AnAcknowledgementDoesNotWaitForTheSyncOfTheSecond) {
  const auto store = this->store(Durability::kSecond);
  deliver(*store, 0);
  bool is_committed = false;
  store->async_commit([&](const std::optional<Error>& error) { is_committed = !error; });
  EXPECT_TRUE(is_committed);
  Sequence next = 1;
  EXPECT_TRUE(run_until([&] {
    deliver(*store, next++);
    return kept() > journal::Place{};
  }));
}

TEST_F(SharedStoreTest, AfterAFailureOfTheDeviceNothingIsKeptAnyMore) {
  const test::CapturedLog log;
  sync_results_ = {Error{"the device is broken"}};
  const auto store = this->store();
  for (Sequence i = 0; i < 2; ++i) {
    deliver(*store, i);
    std::optional<std::optional<Error>> committed;
    store->async_commit([&](std::optional<Error> error) { committed = std::move(error); });
    ASSERT_TRUE(run_until([&] { return committed.has_value(); }));
    EXPECT_TRUE(*committed);
  }
  EXPECT_EQ(kept(), journal::Place{});
}

}  // namespace
}  // namespace orbbuf
