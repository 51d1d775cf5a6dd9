// SPDX-License-Identifier: Apache-2.0
#include "bench/powercut/audit.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "common/drop_record.hpp"
#include "common/file_io.hpp"
#include "common/log.hpp"
#include "common/sample.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf::powercut {
namespace {

namespace fs = std::filesystem;

class Audit {
 public:
  Audit(const Robot& robot, fs::path folder, Counts& counts)
      : robot_(robot), content_(robot.content()), folder_(std::move(folder)), counts_(counts) {}

  void run(const wire::Position& acknowledged, const wire::Position& old) {
    const auto session = read_session(folder_);
    if (!session) return report(session.error().text);
    for (const std::string& problem : session.value().problems) report(problem);
    find_frames(session.value());
    find_items();
    std::uint64_t late = 0;
    for (Sequence step = 0; step < robot_.end(); ++step) {
      count_once(wire::kFrames, step);
      for (const wire::Items& items : content_.items(step)) {
        if (!Content::are_late(items, step)) count_once(items.stream, items.first);
      }
      for (const Content::Late& each : content_.lates(step)) {
        check(each, late < acknowledged[wire::kLate], late < old[wire::kLate]);
        ++late;
      }
    }
    for (const wire::StreamDeclaration& stream : content_.streams()) check_text(stream);
  }

 private:
  void report(const std::string& problem) {
    ++counts_.unexplained;
    log_error("{} {}: {}", robot_.name(), robot_.session(), problem);
  }

  void find_frames(const RecordedSession& session) {
    const auto count = [&](const RecordedFrame& frame) {
      if (!frame.is_replacing) return void(++found_[{wire::kFrames, frame.sequence}]);
      if (!replaced_.insert(frame.sequence).second) ++counts_.repeated;
    };
    if (const auto error = for_each<RecordedFrame>(folder_, count)) report(error->text);
    for (const RecordedFrame& frame : session.frames) {
      const auto images = read_images(folder_, frame);
      const auto is = [&](const EncodedFrame& expected) {
        return images && images.value().jpeg == expected.jpeg &&
               images.value().left_bytes == expected.left_bytes;
      };
      if (is(content_.whole(frame.sequence))) {
        whole_.insert(frame.sequence);
      } else if (!is(content_.live(frame.sequence))) {
        ++counts_.named_but_bad;
      }
      counts_.stereo += frame.is_stereo() ? 1 : 0;
    }
    for (const DropRecord& drop : session.drops) {
      counts_.dropped += drop.frames;
      for (Sequence i = drop.sequence; i < drop.end(); ++i) {
        if (!Content::is_dropped(i)) report(fmt::format("frame {} is named as dropped", i));
        ++found_[{wire::kFrames, i}];
      }
    }
    counts_.frames += session.frames.size();
    counts_.reduced += session.summary.totals.replaced;
    counts_.late += session.summary.totals.late;
    counts_.late_items += session.summary.totals.late_items;
  }

  void find_items() {
    std::map<std::pair<wire::StreamId, std::uint64_t>, wire::Items> expected;
    for (Sequence step = 0; step < robot_.end(); ++step) {
      for (wire::Items& items : content_.items(step)) {
        expected[{items.stream, items.first}] = std::move(items);
      }
    }
    const auto find = [&](const RecordedItems& items) {
      const auto same = expected.find({items.stream, items.first});
      const auto next = items.first + Content::items_a_step(items.stream);
      if (same == expected.end() || items.next != next || items.payload != same->second.payload) {
        return void(++counts_.named_but_bad);
      }
      ++found_[{items.stream, items.first}];
    };
    if (const auto error = read_items(folder_, find)) report(error->text);
  }

  void count_once(wire::StreamId stream, std::uint64_t number) {
    const int times = found_[{stream, number}];
    if (times == 0) report(fmt::format("stream {}: {} is missing", stream, number));
    if (times > 1) ++counts_.repeated;
  }

  void check(const Content::Late& late, bool is_acknowledged, bool is_old) {
    const int times = late.items ? found_[{late.items->stream, late.items->first}]
                                 : static_cast<int>(whole_.count(late.step));
    if (times > 1) ++counts_.repeated;
    if (times > 0) return;
    if (!is_acknowledged) return report(fmt::format("step {}: what is late is missing", late.step));
    ++counts_.acknowledged_lost;
    counts_.old_lost += is_old ? 1 : 0;
  }

  /// The view of a stream has what is in the journal, line by line.
  void check_text(const wire::StreamDeclaration& stream) {
    const bool is_topic = stream.codec == wire::kTopicCodec;
    std::string expected(is_topic ? kMessageHeader : kEurocImuHeader);
    for (Sequence step = 0; step < robot_.end(); ++step) {
      for (const wire::Items& items : content_.items(step)) {
        if (items.stream != stream.id || found_[{stream.id, items.first}] == 0) continue;
        const auto samples = wire::parse_samples(stream.codec, items.payload);
        for (const Sample& sample : samples.value()) {
          expected += to_line(sample);
          ++(is_topic ? counts_.messages : counts_.samples);
        }
      }
    }
    const auto text = read_text(folder_ / session_names::samples(stream));
    if (!text || text.value() != expected)
      report(stream.name + ": its text is not what was captured");
  }

  const Robot& robot_;
  const Content& content_;
  const fs::path folder_;
  Counts& counts_;
  std::map<std::pair<wire::StreamId, std::uint64_t>, int> found_;  // by stream and first number
  std::set<Sequence> whole_;
  std::set<Sequence> replaced_;
};

}  // namespace

void audit(const Robot& robot, const fs::path& folder, const wire::Position& acknowledged,
           const wire::Position& old, Counts& counts) {
  Audit(robot, folder, counts).run(acknowledged, old);
}

}  // namespace orbbuf::powercut
