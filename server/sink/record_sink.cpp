// SPDX-License-Identifier: Apache-2.0
#include "server/sink/record_sink.hpp"

#include <spdlog/spdlog.h>

#include <boost/asio/post.hpp>
#include <utility>

#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {
namespace asio = boost::asio;

struct RecordSink::Job {
  Records records;        // in the pool only
  std::size_t next = 0;   // the first record that lacks what is written; in the pool only
  bool is_begun = false;  // `next` is not the first; on `main` only
};

RecordSink::RecordSink(asio::io_context& main, asio::thread_pool& pool, Records records,
                       wire::Position position, Commit commit)
    : main_(main),
      strand_(asio::make_strand(pool)),
      job_(std::make_shared<Job>(Job{std::move(records)})),
      position_(position),
      commit_(commit) {}

RecordSink::~RecordSink() = default;

void RecordSink::async_write(FramePtr frame, Done done) {
  write_each([frame = std::move(frame)](SessionRecord& record) { return record.write(*frame); },
             std::move(done));
}

void RecordSink::async_write_drops(wire::Dropped dropped, Done done) {
  write_each(
      [dropped = std::move(dropped)](SessionRecord& record) { return record.write_drops(dropped); },
      std::move(done));
}

void RecordSink::write_each(Write write, Done done) {
  struct Outcome {
    std::optional<Error> error;
    bool is_begun = false;
  };
  run_in_pool(
      main_, strand_,
      [job = job_, write = std::move(write)]() -> Outcome {
        for (; job->next < job->records.size(); ++job->next) {
          if (auto error = write(*job->records[job->next]))
            return {std::move(error), job->next > 0};
        }
        job->next = 0;
        return {};
      },
      [job = job_, done = std::move(done)](const Outcome& outcome) {
        job->is_begun = outcome.is_begun;
        done(outcome.error);
      });
}

void RecordSink::async_commit(Done done) {
  if (commit_.group == nullptr) return done({});
  if (commit_.is_awaited) return commit_.group->async_commit(std::move(done));
  if (!std::exchange(*is_commit_due_, true)) {
    commit_.group->async_commit([is_due = is_commit_due_](const auto&) { *is_due = false; });
  }
  done({});
}

void RecordSink::note(const SessionClosing& reported) {
  asio::post(strand_, [job = job_, reported] {
    for (const auto& record : job->records) record->note(reported);
  });
}

bool RecordSink::is_partly_taken() const { return job_->is_begun; }

void RecordSink::async_drain(const SessionClosing& closing, std::function<void()> drained) {
  run_in_pool(
      main_, strand_,
      [job = job_, closing = closing]() mutable {
        // The last one, the files, may know more than the session does.
        for (std::size_t i = job->records.size(); i-- > 0;) {
          if (const auto error = job->records[i]->finish(closing))
            spdlog::warn("not finished: {}", error->text);
        }
        return true;
      },
      [drained = std::move(drained)](bool /*is_over*/) { drained(); });
}

}  // namespace orbbuf
