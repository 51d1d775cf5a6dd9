// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/group_commit.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <boost/asio/post.hpp>
#include <future>
#include <thread>

#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

class GroupCommitTest : public testing::Test {
 protected:
  boost::asio::io_context main_{1};
  test::CapturedLog log_;
};

TEST_F(GroupCommitTest, ThoseWhoComeDuringASyncShareTheNext) {
  std::promise<void> first_may_end;
  std::atomic<int> syncs = 0;
  std::promise<void> begun;
  GroupCommit commit(
      main_,
      [&]() -> std::optional<Error> {
        if (++syncs == 1) {
          begun.set_value();
          first_may_end.get_future().wait();
        }
        return std::nullopt;
      },
      0ms, "the consequence");
  int done = 0;
  const auto count = [&](const std::optional<Error>& error) {
    EXPECT_FALSE(error);
    ++done;
  };
  commit.async_commit(count);
  std::thread releaser([&] {
    begun.get_future().wait();
    boost::asio::post(main_, [&] {
      for (int i = 0; i < 3; ++i) commit.async_commit(count);
      EXPECT_EQ(done, 0);
      first_may_end.set_value();
    });
  });
  main_.run();
  releaser.join();
  EXPECT_EQ(done, 4);
  EXPECT_EQ(syncs, 2);
}

TEST_F(GroupCommitTest, ADeviceThatFailedIsNotTrustedAgain) {
  int syncs = 0;
  GroupCommit commit(
      main_,
      [&]() -> std::optional<Error> {
        if (++syncs == 1) return Error{"sync: Input/output error"};
        return std::nullopt;
      },
      0ms, "the consequence");
  int errors = 0;
  const auto count = [&](const std::optional<Error>& error) {
    errors += error.has_value() ? 1 : 0;
  };
  commit.async_commit([&](const std::optional<Error>& error) {
    count(error);
    commit.async_commit(count);
  });
  EXPECT_FALSE(commit.has_failed());
  main_.run();
  EXPECT_TRUE(commit.has_failed());
  EXPECT_EQ(errors, 2);
  EXPECT_EQ(syncs, 1);
  EXPECT_EQ(log_.lines("error "),
            std::vector<std::string>{"error sync: Input/output error; the consequence: check the "
                                     "disk, then restart the server"});
}

TEST_F(GroupCommitTest, SyncsTheFileSystemOfAFolder) {
  const test::TemporaryFolder folder;
  GroupCommit commit(main_, folder.path(), 0ms, "");
  bool is_done = false;
  commit.async_commit([&](const std::optional<Error>& error) { is_done = !error; });
  EXPECT_FALSE(is_done);
  main_.run();
  EXPECT_TRUE(is_done);
}

}  // namespace
}  // namespace orbbuf
