// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/earlier_segments.hpp"

#include <fmt/core.h>

#include "server/http/http_server.hpp"
#include "server/session/session_store.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/event_loop.hpp"
#include "tests/server/fleet/fake_key_store.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf::fleet {
namespace {

namespace fs = std::filesystem;
using test::plain_frame;
using test::plain_pair;

const SessionName kName{"robot", "s"};

/// Server `c`, whose segment of the session is that of epoch 3, and the pages of others.
class EarlierSegmentsTest : public test::EventLoop {
 protected:
  ~EarlierSegmentsTest() override {
    for (const auto& page : pages_) page->stop();
    if (earlier_) earlier_->close();
    run_ready();
  }

  /// Records frames in a server's folder.
  void record(const std::string& folder, std::vector<EncodedFrame> frames) const {
    const auto store =
        SessionStore::open(folder_ / folder, {"robot", "s", "", {}}, Durability::kOff);
    ASSERT_TRUE(store);
    for (EncodedFrame& frame : frames) {
      frame.capture_time_ns =
          static_cast<std::int64_t>(frame.sequence) * 1'000'000'000 + 500'000'000;
      ASSERT_FALSE(store.value()->write(frame, 0));
    }
  }
  static std::vector<EncodedFrame> plain(Sequence first, Sequence end) {
    std::vector<EncodedFrame> frames;
    for (Sequence i = first; i < end; ++i) frames.push_back(plain_frame(i));
    return frames;
  }

  HttpServer& serve(const std::string& server) {
    Settings settings;
    settings.http_address = Address{"127.0.0.1", 0};
    settings.sinks.files_path = folder_ / server;
    pages_.push_back(std::make_unique<HttpServer>(main_, files_, settings, metrics_));
    pages_.back()->start();
    announce(server, fmt::format("127.0.0.1:{}", pages_.back()->endpoint().port()));
    return *pages_.back();
  }
  /// Its key in etcd.
  void announce(const std::string& server, const std::string& http) {
    const ServerEntry entry{server, "i", server + ":7722", http, 0, false};
    keys_.keys[entry.key()] = {entry.key(), to_text(entry), 1};
  }
  void own(std::vector<Segment> segments) {
    const SessionOwner owner{"c", "i", segments.back().epoch, std::move(segments), false};
    keys_.keys[kName.owner_key()] = {kName.owner_key(), to_text(owner), 1};
  }
  void begin(std::chrono::milliseconds patience = std::chrono::minutes(1)) {
    earlier_ = std::make_shared<EarlierSegments>(
        main_, files_, store_, EarlierSegments::Options{kName, 3, "c", folder_ / "c", patience});
  }
  FramePtr next(Sequence first) {
    std::optional<FramePtr> answer;
    earlier_->async_next(first, [&](FramePtr frame) { answer = std::move(frame); });
    EXPECT_FALSE(answer);
    EXPECT_TRUE(run_until([&] {
      store_.deliver_all();
      return answer.has_value();
    }));
    return answer.value_or(nullptr);
  }
  /// All from there on.
  std::vector<Sequence> rest(Sequence first = 0) {
    std::vector<Sequence> sequences;
    while (const FramePtr frame = next(first)) {
      sequences.push_back(frame->sequence);
      first = frame->sequence + 1;
    }
    return sequences;
  }

  test::TemporaryFolder folder_;
  test::CapturedLog log_;
  Metrics metrics_{1};
  test::FakeKeys keys_;
  test::FakeKeyStore store_{keys_};
  std::vector<std::unique_ptr<HttpServer>> pages_;
  std::shared_ptr<EarlierSegments> earlier_;
};

TEST_F(EarlierSegmentsTest, FramesComeFromTheOtherServersPagesAndFromHereEachOnce) {
  record("a/robot/s", plain(0, 5));     // it had received two that it did not acknowledge
  record("c/robot/s.e2", plain(3, 5));  // ours, before
  record("b/robot/s.e3", plain(5, 8));
  serve("a");
  serve("b");
  own({{"a", 1, {}}, {"c", 2, {3, 0}}, {"b", 3, {5, 0}}, {"c", 4, {8, 0}}});
  earlier_ = std::make_shared<EarlierSegments>(
      main_, files_, store_, EarlierSegments::Options{kName, 4, "c", folder_ / "c"});
  const FramePtr first = next(0);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->jpeg, plain_frame(0).jpeg);
  EXPECT_EQ(first->capture_time_ns, 500'000'000);
  EXPECT_EQ(rest(1), (std::vector<Sequence>{1, 2, 3, 4, 5, 6, 7}));
  EXPECT_EQ(rest(2), (std::vector<Sequence>{2, 3, 4, 5, 6, 7}));  // again, for another reader
  EXPECT_EQ(log_.lines("warning").size(), 0U);
  EXPECT_EQ(log_.lines("frames 0 to 7 are read from 3 earlier segments").size(), 1U);
}

TEST_F(EarlierSegmentsTest, AStereoFrameHasBothImages) {
  record("a/robot/s", {plain_pair(0, 100, 50), plain_pair(1, 70, 80)});
  serve("a");
  own({{"a", 1, {}}, {"c", 3, {2, 0}}});
  begin();
  for (const EncodedFrame& pair : {plain_pair(0, 100, 50), plain_pair(1, 70, 80)}) {
    const FramePtr frame = next(pair.sequence);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->jpeg, pair.jpeg);
    EXPECT_EQ(frame->left_bytes, pair.left_bytes);
  }
  EXPECT_FALSE(next(2));
}

TEST_F(EarlierSegmentsTest, ServersThatDoNotAnswerAreOneWarningEachAndThenPassedOver) {
  record("b/robot/s.e2", plain(4, 6));
  announce("a", "127.0.0.1:1");
  serve("b");
  own({{"a", 1, {}}, {"b", 2, {4, 0}}, {"gone", 2, {6, 0}}, {"c", 3, {9, 0}}});
  begin(std::chrono::milliseconds(0));
  EXPECT_EQ(rest(), (std::vector<Sequence>{4, 5}));
  EXPECT_EQ(rest(), (std::vector<Sequence>{4, 5}));
  EXPECT_EQ(log_.lines("robot/s: frames 0 to 3 are passed over: segment s of server a: "
                       "fetch http://127.0.0.1:1/")
                .size(),
            1U);
  EXPECT_EQ(log_.lines("robot/s: frames 6 to 8 are passed over: segment s.e2 of server gone: "
                       "the server does not live, or has no page")
                .size(),
            1U);
  EXPECT_EQ(log_.lines("warning").size(), 2U);
}

TEST_F(EarlierSegmentsTest, AServerThatIsStartedAgainIsWaitedFor) {
  record("a/robot/s", plain(0, 4));
  HttpServer& page = serve("a");
  own({{"a", 1, {}}, {"c", 3, {4, 0}}});
  begin();
  EXPECT_TRUE(next(0));
  page.stop();
  std::optional<FramePtr> answer;
  earlier_->async_next(1, [&](FramePtr frame) { answer = std::move(frame); });
  ASSERT_TRUE(run_until([&] { return store_.sent() > 0; }));  // it asks etcd again
  EXPECT_FALSE(answer);
  serve("a");  // elsewhere
  ASSERT_TRUE(run_until([&] {
    store_.deliver_all();
    return answer.has_value();
  }));
  ASSERT_TRUE(*answer);
  EXPECT_EQ((*answer)->sequence, 1U);
  EXPECT_EQ(rest(2), (std::vector<Sequence>{2, 3}));
  EXPECT_EQ(log_.lines("warning").size(), 0U);
}

TEST_F(EarlierSegmentsTest, ImagesThatAreMissingArePassedOverWithOneWarning) {
  record("a/robot/s", plain(0, 5));
  fs::remove(folder_ / "a/robot/s/images/000001.jpg");
  fs::remove(folder_ / "a/robot/s/images/000003.jpg");
  serve("a");
  own({{"a", 1, {}}, {"c", 3, {5, 0}}});
  begin();
  EXPECT_EQ(rest(), (std::vector<Sequence>{0, 2, 4}));
  EXPECT_EQ(log_.lines("images/000001.jpg is not there").size(), 1U);
  EXPECT_EQ(log_.lines("warning").size(), 1U);
}

TEST_F(EarlierSegmentsTest, ASegmentThatItsServerHasRemovedIsPassedOverAtOnce) {
  serve("a");
  own({{"a", 1, {}}, {"c", 3, {5, 0}}});
  begin();
  EXPECT_FALSE(next(0));
  EXPECT_EQ(log_.lines("the server does not have it any more").size(), 1U);
}

TEST_F(EarlierSegmentsTest, WithoutAnAnswerOfEtcdItEndsWithAWarning) {
  begin(std::chrono::milliseconds(0));
  std::optional<FramePtr> answer;
  earlier_->async_next(0, [&](FramePtr frame) { answer = std::move(frame); });
  ASSERT_TRUE(run_until([&] { return store_.sent() > 0; }));
  store_.fail();
  ASSERT_TRUE(run_until([&] { return answer.has_value(); }));
  EXPECT_FALSE(*answer);
  EXPECT_EQ(log_.lines("frames before this server's segment are passed over: no answer").size(),
            1U);
  EXPECT_FALSE(next(0));
}

TEST_F(EarlierSegmentsTest, CloseEndsTheWait) {
  announce("a", "127.0.0.1:1");
  own({{"a", 1, {}}, {"c", 3, {5, 0}}});
  begin();
  std::optional<FramePtr> answer;
  earlier_->async_next(0, [&](FramePtr frame) { answer = std::move(frame); });
  ASSERT_TRUE(run_until([&] { return store_.sent() > 0; }));
  store_.deliver_all();
  run_ready();
  EXPECT_FALSE(answer);
  earlier_->close();
  ASSERT_TRUE(run_until([&] {
    store_.deliver_all();
    return answer.has_value();
  }));
  EXPECT_FALSE(*answer);
  EXPECT_FALSE(next(0));
}

}  // namespace
}  // namespace orbbuf::fleet
