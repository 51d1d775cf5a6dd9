// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/earlier_segments.hpp"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <string_view>
#include <utility>

#include "common/log.hpp"
#include "server/runtime/run_in_pool.hpp"
#include "server/session/session_lines.hpp"
#include "server/session/session_names.hpp"

namespace orbbuf::fleet {

namespace asio = boost::asio;
using boost::system::error_code;

EarlierSegments::EarlierSegments(asio::io_context& main, asio::thread_pool& files, KeyStore& store,
                                 Options options)
    : main_(main), files_(files), store_(store), options_(std::move(options)), retry_(main) {}

void EarlierSegments::async_next(Sequence first, Done done) {
  if (source_ && first < first_) source_->offset = 0;
  first_ = first;
  done_ = std::move(done);
  asio::post(main_, [self = shared_from_this()] { self->step(); });
}

void EarlierSegments::close() {
  is_closed_ = true;
  retry_.cancel();
  if (source_ && source_->client) source_->client->close();
}

void EarlierSegments::find() {
  async_find_session(store_, options_.session, [self = shared_from_this()](const auto& found) {
    if (!found) return self->on_failed(found.error().text);
    self->on_found(found.value().segments);
    self->step();
  });
}

void EarlierSegments::on_found(const std::vector<FoundSegment>& found) {
  const bool is_first_time = !parts_;
  if (is_first_time) parts_.emplace();
  for (std::size_t i = 0; i + 1 < found.size(); ++i) {
    const auto& [segment, http] = found[i];
    if (segment.epoch >= options_.epoch) break;
    if (i == parts_->size()) {
      parts_->push_back({segment, found[i + 1].segment.from[wire::kFrames], "", false});
    }
    (*parts_)[i].http = http;
  }
  if (!is_first_time || parts_->empty()) return;
  log_info("{}: frames {} to {} are read from {} earlier segments", options_.session.text(), first_,
           parts_->back().end - 1, parts_->size());
}

/// The one place that decides what is next.
void EarlierSegments::step() {
  if (is_closed_) return finish(nullptr);
  if (!parts_) return find();
  const auto part = next_part();
  if (part == parts_->end()) {
    source_.reset();
    return finish(nullptr);
  }
  const auto index = static_cast<std::size_t>(part - parts_->begin());
  if (!source_ || source_->part != index) open(index);
  if (source_->local) return read_local();
  if (!source_->client) {
    return on_failed(part->http.empty() ? "the server does not live, or has no page"
                                        : part->http + ": not HOST:PORT");
  }
  source_->times ? fetch_next() : fetch_times();
}

/// The one that has the first frame from first_ on; requires parts_.
std::vector<EarlierSegments::Part>::iterator EarlierSegments::next_part() {
  return std::ranges::find_if(*parts_, [this](const Part& part) {
    const Sequence from = part.segment.from[wire::kFrames];
    return !part.is_given_up && std::max(from, first_) < part.end;
  });
}

void EarlierSegments::open(std::size_t part) {
  const Part& chosen = (*parts_)[part];
  const std::string folder = folder_of(options_.session.session_id, chosen.segment);
  source_ = Source{};
  source_->part = part;
  source_->path = page_path(options_.session.robot_id, folder);
  if (chosen.segment.server == options_.server) {
    source_->local =
        std::make_shared<FrameFollower>(options_.files / options_.session.robot_id / folder);
  } else if (auto page = parse_address(chosen.http)) {
    source_->client = std::make_shared<PageClient>(main_, std::move(page).value());
  }
}

void EarlierSegments::read_local() {
  run_in_pool(
      main_, files_,
      [follower = source_->local, first = first_] {
        auto frame = follower->next(first);
        follower->take_items();  // frames only are handed on
        return frame;
      },
      [self = shared_from_this()](Result<FramePtr> frame) { self->on_local(std::move(frame)); });
}

void EarlierSegments::on_local(Result<FramePtr> frame) {
  if (!frame) return on_failed(frame.error().text);
  if (!frame.value() || frame.value()->sequence >= (*parts_)[source_->part].end) {
    return on_part_over();
  }
  finish(std::move(frame).value());
}

/// use: of what is in that file; nothing: there is none.
template <class Use>
void EarlierSegments::get(const std::string& file, Use use) {
  source_->client->async_get(source_->path + file,
                             [self = shared_from_this(), use = std::move(use)](auto got) mutable {
                               if (!got) return self->on_failed(got.error().text);
                               use(std::move(got).value());
                             });
}

void EarlierSegments::fetch_times() {
  get(session_names::kTimes, [this](std::optional<std::string> times) {
    if (!times) return give_up("the server does not have it any more");
    source_->times = std::move(times);
    fetch_next();
  });
}

void EarlierSegments::fetch_next() {
  const std::string_view times = *source_->times;
  for (;;) {
    const std::size_t end = times.find('\n', source_->offset);
    if (end == times.npos) return on_part_over();
    const auto listed =
        session_lines::parse_times(times.substr(source_->offset, end - source_->offset));
    if (listed && listed->sequence >= (*parts_)[source_->part].end) return on_part_over();
    if (listed && listed->sequence >= first_) {
      const auto use = [this, sequence = listed->sequence,
                        time = listed->capture_time_ns](std::optional<std::string> left) {
        on_left(sequence, time, std::move(left));
      };
      return get(session_names::left_image(listed->sequence), use);
    }
    source_->offset = end + 1;
  }
}

void EarlierSegments::on_left(Sequence sequence, std::int64_t time_ns,
                              std::optional<std::string> left) {
  if (!left) return pass_over(sequence, session_names::left_image(sequence));
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = time_ns;
  frame.jpeg.assign(left->begin(), left->end());
  frame.left_bytes = static_cast<std::uint32_t>(frame.jpeg.size());
  if (source_->is_stereo == false) {
    return finish(std::make_shared<const EncodedFrame>(std::move(frame)));
  }
  fetch_right(std::move(frame));
}

void EarlierSegments::fetch_right(EncodedFrame frame) {
  const std::string image = session_names::right_image(frame.sequence);
  get(image, [this, image, frame = std::move(frame)](std::optional<std::string> right) mutable {
    if (!right && source_->is_stereo) return pass_over(frame.sequence, image);
    source_->is_stereo = right.has_value();
    if (right) frame.jpeg.insert(frame.jpeg.end(), right->begin(), right->end());
    finish(std::make_shared<const EncodedFrame>(std::move(frame)));
  });
}

void EarlierSegments::pass_over(Sequence sequence, const std::string& image) {
  if (!std::exchange(source_->has_warned, true)) {
    log_warn("{}: {}: {} is not there; passed over, as are others like it", options_.session.text(),
             to_string(source_->client->page()), image);
  }
  first_ = sequence + 1;
  step();
}

void EarlierSegments::on_part_over() {
  failing_since_.reset();
  first_ = (*parts_)[source_->part].end;
  step();
}

/// What cannot be read now may be in a moment, and etcd may then know another page.
void EarlierSegments::on_failed(const std::string& why) {
  if (is_closed_) return finish(nullptr);
  source_.reset();
  const auto now = Clock::now();
  if (!failing_since_) failing_since_ = now;
  if (now - *failing_since_ >= options_.patience) return give_up(why);
  retry_.expires_after(kRetry);
  retry_.async_wait([self = shared_from_this()](const error_code& /*closed*/) {
    self->is_closed_ ? self->finish(nullptr) : self->find();
  });
}

void EarlierSegments::give_up(const std::string& why) {
  failing_since_.reset();
  source_.reset();
  if (!parts_) {
    log_warn("{}: frames before this server's segment are passed over: {}", options_.session.text(),
             why);
    parts_.emplace();
  } else if (const auto part = next_part(); part != parts_->end()) {
    part->is_given_up = true;
    log_warn("{}: frames {} to {} are passed over: segment {} of server {}: {}",
             options_.session.text(), std::max(first_, part->segment.from[wire::kFrames]),
             part->end - 1, folder_of(options_.session.session_id, part->segment),
             part->segment.server, why);
  }
  step();
}

void EarlierSegments::finish(FramePtr frame) {
  failing_since_.reset();
  std::exchange(done_, nullptr)(std::move(frame));
}

}  // namespace orbbuf::fleet
