// SPDX-License-Identifier: Apache-2.0
#include "server/sink/paced_sink.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <chrono>
#include <exception>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;

constexpr std::size_t kMostWaitingBytes = std::size_t{64} << 20U;
constexpr std::size_t kMostPacedBytes = std::size_t{32} << 20U;
/// A reader that keeps 10 messages may be busy for 30 ms.
constexpr std::chrono::milliseconds kBetweenMessages{10};

}  // namespace

PacedThreads::PacedThreads(const char* name, unsigned count) : pool(count) {
  name_threads(pool, name, count);
}

void PacedThreads::finish(Pace::Clock::time_point end) {
  last = end;
  const std::scoped_lock lock(mutex);
  for (const auto& session : busy) {
    asio::post(session->strand, [session] { session->publish_due(); });
  }
}

void PacedThreads::set_busy(const std::shared_ptr<PacedSession>& session, bool is_busy) {
  const std::scoped_lock lock(mutex);
  if (is_busy) {
    busy.insert(session);
  } else {
    busy.erase(session);
  }
}

PacedSession::PacedSession(PacedThreads& threads, const SessionInfo& info, std::string_view kind,
                           const Pace& frames, std::chrono::nanoseconds backlog)
    : losses(fmt::format("{} {}: {}", info.robot_id, info.session_id, kind)),
      strand(asio::make_strand(threads.pool)),
      session_(info.robot_id + " " + info.session_id),
      streams_(info.streams),
      threads_(threads),
      backlog_(backlog),
      frames_(frames),
      paces_(streams_.size(), Pace(frames.speed() * kFaster, kBetweenMessages, kBetweenMessages)),
      timer_(strand) {}

void PacedSession::add(FramePtr frame) {
  const std::size_t bytes = frame->jpeg.size();
  const Sequence number = frame->sequence;
  messages_.push_back({std::move(frame), 0, number, {}, bytes});
  publish_due();
}

void PacedSession::add(const ItemsPtr& items) {
  const auto stream = std::ranges::find(streams_, items->stream, &wire::StreamDeclaration::id);
  auto samples = wire::parse_samples(streams_, items->stream, items->payload);
  threads_.waiting_bytes -= items->payload.size();
  if (!samples) return;
  const auto index = static_cast<std::size_t>(stream - streams_.begin());
  Sequence number = items->first;
  for (Sample& sample : samples.value()) add(index, number++, std::move(sample));
  publish_due();
}

void PacedSession::add(std::size_t stream, Sequence number, Sample sample) {
  Message message{nullptr, stream, number, std::move(sample), sizeof(Message)};
  if (const auto& of_topic = message.sample.message) {
    message.bytes += of_topic->cdr.size();
    try {
      message.begin = begin_of(*of_topic);
    } catch (const std::exception&) {  // publish() tries again, and says why
    }
  }
  threads_.waiting_bytes += message.bytes;
  messages_.push_back(std::move(message));
}

void PacedSession::publish_due() {
  const auto self = shared_from_this();
  threads_.set_busy(self, true);
  if (const auto next = publish_until()) {
    timer_.expires_at(*next);
    timer_.async_wait([weak = weak_from_this()](const boost::system::error_code& error) {
      const auto session = weak.lock();
      if (session && !error) session->publish_due();
    });
  } else {
    timer_.cancel();
    threads_.set_busy(self, false);
  }
}

const EncodedFrame* PacedSession::first_frame() const {
  const auto first =
      std::ranges::find_if(messages_, [](const Message& each) { return each.frame != nullptr; });
  return first == messages_.end() ? nullptr : first->frame.get();
}

bool PacedSession::is_last() const { return threads_.last.load() != Clock::time_point::max(); }

/// When to go on; nothing: nothing waits.
std::optional<PacedSession::Clock::time_point> PacedSession::publish_until() {
  if (!is_last()) {
    if (const auto next = wait_for_readers()) return next;
  }
  std::optional<Clock::time_point> next;
  for (auto message = messages_.begin(); message != messages_.end();) {
    const auto now = Clock::now();
    if (message->begin > now && !is_last()) {
      next = std::min(next.value_or(message->begin), message->begin);
      ++message;
      continue;
    }
    if (const auto due = due_time(*message); due > now) {
      next = std::min(next.value_or(due), due);
      break;
    }
    publish(*message);
    threads_.waiting_bytes -= message->bytes;
    message = messages_.erase(message);
  }
  return next;
}

double PacedSession::haste(const Message& message) const {
  const auto behind = static_cast<double>(messages_.back().time_ns() - message.time_ns());
  return std::max(1.0, behind / static_cast<double>(backlog_.count()));
}

PacedSession::Clock::time_point PacedSession::due_time(const Message& message) const {
  if (is_last() || threads_.waiting_bytes > kMostPacedBytes) return {};
  const Pace& pace = message.frame ? frames_ : paces_[message.stream];
  return pace.due(message.number, message.time_ns(), haste(message));
}

void PacedSession::publish(const Message& message) {
  const auto now = Clock::now();
  if (now > threads_.last.load()) return losses.add("the server stops");
  try {
    const auto error =
        message.frame ? publish(*message.frame) : publish(streams_[message.stream], message.sample);
    if (error) losses.add(error->text);
  } catch (const std::exception& error) {
    losses.add(error.what());
  }
  Pace& pace = message.frame ? frames_ : paces_[message.stream];
  pace.published(message.number, message.time_ns(), now, haste(message));
}

PacedSink::PacedSink(asio::io_context& main, PacedThreads& threads,
                     std::shared_ptr<PacedSession> session)
    : main_(main), threads_(threads), session_(std::move(session)) {}

PacedSink::~PacedSink() {
  const PoolStrand strand = session_->strand;
  asio::post(strand, [session = std::move(session_)] {});  // which ends there
}

void PacedSink::async_write(FramePtr frame, Done done) {
  const std::size_t bytes = frame->jpeg.size();
  publish_later(std::move(frame), bytes);
  asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
}

void PacedSink::async_write_items(ItemsPtr items, Done done) {
  const std::size_t bytes = items->payload.size();
  if (items->stream >= wire::kFirstOther) publish_later(std::move(items), bytes);
  asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
}

template <class Message>
void PacedSink::publish_later(Message message, std::size_t bytes) {
  if (threads_.waiting_bytes + bytes > kMostWaitingBytes) {
    return session_->losses.add("64 MiB of frames and messages wait");
  }
  threads_.waiting_bytes += bytes;
  asio::post(session_->strand,
             [session = session_, message = std::move(message)] { session->add(message); });
}

}  // namespace orbbuf
