// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cstddef>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/error.hpp"
#include "common/sample.hpp"
#include "server/runtime/run_in_pool.hpp"
#include "server/session/session_info.hpp"
#include "server/sink/frame_sink.hpp"
#include "server/sink/losses.hpp"
#include "server/sink/pace.hpp"

namespace orbbuf {

class PacedSession;

/// What the sessions of a kind of sink share: threads, and the memory of what waits for them.
struct PacedThreads {
  explicit PacedThreads(const char* name, unsigned count = 1);

  /// When no sink is left. From now on nothing is paced: what waits goes at once, and what is left
  /// at `end` is given up.
  void finish(Pace::Clock::time_point end);
  void set_busy(const std::shared_ptr<PacedSession>& session, bool is_busy);

  std::atomic<std::size_t> waiting_bytes{0};
  std::atomic<Pace::Clock::time_point> last{Pace::Clock::time_point::max()};  // max: none
  std::mutex mutex;
  std::set<std::shared_ptr<PacedSession>> busy;  // guarded by mutex: what has something that waits
  boost::asio::thread_pool pool;                 // at the end: its work uses the others
};

/// A session on its way to readers that do not hold the stream, in the order in which it came; what
/// comes in a burst is spread by Pace, faster if it is of more than `backlog`, and not if 32 MiB
/// wait. Samples and messages of topics go up to kFaster times faster than frames, since their
/// readers need less time for one. All on `strand`, but for `losses`: a session waits for
/// another's work only if all threads work.
class PacedSession : public std::enable_shared_from_this<PacedSession> {
 public:
  using Clock = Pace::Clock;

  static constexpr double kFaster = 4;

  /// kind: of the sink, for the log. frames: their pace; backlog: see above.
  PacedSession(PacedThreads& threads, const SessionInfo& info, std::string_view kind,
               const Pace& frames,
               std::chrono::nanoseconds backlog = std::chrono::nanoseconds::max());
  virtual ~PacedSession() = default;
  PacedSession(const PacedSession&) = delete;
  PacedSession& operator=(const PacedSession&) = delete;

  void add(FramePtr frame);
  void add(const ItemsPtr& items);
  void publish_due();

  Losses losses;
  const PoolStrand strand;

 protected:
  /// That of a stream by its place in `streams_`.
  void add(std::size_t stream, Sequence number, Sample sample);

  /// Nothing: readers are there; else when to ask again, and nothing goes until then.
  virtual std::optional<Clock::time_point> wait_for_readers() = 0;
  /// Messages of a topic that is new wait until then, and delay nothing else.
  virtual Clock::time_point begin_of(const TopicMessage& /*message*/) { return {}; }
  /// An error, or what is thrown, is why it is lost.
  virtual std::optional<Error> publish(const EncodedFrame& frame) = 0;
  virtual std::optional<Error> publish(const wire::StreamDeclaration& stream,
                                       const Sample& sample) = 0;

  /// Of those that wait; null: there is none.
  const EncodedFrame* first_frame() const;

  const std::string session_;  // for the log
  const std::vector<wire::StreamDeclaration> streams_;

 private:
  struct Message {
    FramePtr frame;  // null: a sample
    std::size_t stream = 0;
    Sequence number = 0;
    Sample sample{};
    std::size_t bytes = 0;
    Clock::time_point begin{};

    std::int64_t time_ns() const { return frame ? frame->capture_time_ns : sample.time_ns; }
  };

  bool is_last() const;
  std::optional<Clock::time_point> publish_until();
  double haste(const Message& message) const;
  Clock::time_point due_time(const Message& message) const;
  void publish(const Message& message);

  PacedThreads& threads_;
  const std::chrono::nanoseconds backlog_;
  std::deque<Message> messages_;
  Pace frames_;
  std::vector<Pace> paces_;  // of the streams
  boost::asio::steady_timer timer_;
};

/// Hands a session on to its strand. It answers each frame at once, and never pauses the stream: up
/// to 64 MiB of all sessions wait; what finds these full is given up.
class PacedSink : public FrameSink {
 public:
  PacedSink(boost::asio::io_context& main, PacedThreads& threads,
            std::shared_ptr<PacedSession> session);
  ~PacedSink() override;
  PacedSink(const PacedSink&) = delete;
  PacedSink& operator=(const PacedSink&) = delete;

  void async_write(FramePtr frame, Done done) override;
  bool takes_items() const override { return true; }
  void async_write_items(ItemsPtr items, Done done) override;
  std::uint64_t lost() const override { return session_->losses.count(); }

 private:
  template <class Message>
  void publish_later(Message message, std::size_t bytes);

  boost::asio::io_context& main_;
  PacedThreads& threads_;
  std::shared_ptr<PacedSession> session_;  // shared with what waits on its strand
};

}  // namespace orbbuf
