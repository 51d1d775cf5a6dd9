// SPDX-License-Identifier: Apache-2.0
#include "server/http/figures_json.hpp"

#include <spdlog/fmt/fmt.h>

#include <iterator>

namespace orbbuf {
namespace {

std::uint64_t to_ms(RobotFigures::Time time) {
  using std::chrono::milliseconds;
  return static_cast<std::uint64_t>(
      std::chrono::duration_cast<milliseconds>(time.time_since_epoch()).count());
}

/// A text in the making. All that goes in is ids, numbers and truth values: nothing needs escaping.
class Json {
 public:
  template <class... Values>
  void add(fmt::format_string<Values...> format, Values&&... values) {
    fmt::format_to(std::back_inserter(text_), format, std::forward<Values>(values)...);
  }
  /// Before each element of a list but the first.
  void separate() {
    if (text_.back() != '[') text_ += ',';
  }
  std::string take() && { return std::move(text_); }

 private:
  std::string text_;
};

void add_report(Json& json, const wire::Report& report, double age_s) {
  const wire::Stats& account = report.account;
  json.add(R"("report":{{"age_s":{:.3f},"captured":{},"skipped":{},"failed":{},"dropped":{},)"
           R"("acknowledged":{},"waiting":{},"in_flight":{},"capacity":{},"waiting_bytes":{},)"
           R"("link_rate":{},"round_trip_us":{}}},)",
           age_s, account.captured, account.skipped, account.failed, account.dropped,
           account.acknowledged, account.waiting, account.in_flight, report.capacity,
           report.waiting_bytes, report.link_rate, report.round_trip_us);
}

/// Nothing has come for longer than the robot is ever silent.
bool is_silent(const RobotFigures& robot, RobotFigures::Time now) {
  constexpr std::chrono::seconds kLongestPause{5};
  return !robot.is_ended() &&
         (!robot.is_connected() || now - robot.timeline().last_heard() > kLongestPause);
}

void add_timeline(Json& json, const RobotFigures& robot, std::uint64_t since_ms,
                  RobotFigures::Time now) {
  const Timeline& timeline = robot.timeline();
  json.add(R"("now":{:.3f},"outages":[)",
           to_seconds(timeline.robot_time(robot.ended_at().value_or(now))));
  for (const Outage& outage : timeline.outages()) {
    json.separate();
    json.add("[{:.3f},{:.3f}]", to_seconds(outage.begin), to_seconds(outage.end));
  }
  if (is_silent(robot, now)) {
    json.separate();
    json.add("[{:.3f},null]", to_seconds(timeline.robot_time(timeline.last_heard())));
  }
  json.add(R"(],"seconds":[)");
  for (const TimelineSecond& second : timeline.seconds()) {
    if (to_ms(second.changed) < since_ms) continue;
    json.separate();
    json.add("[{},{},{},{},{}]", second.second, second.delivered, second.dropped,
             second.similarity == kUnknownSimilarity ? -1 : second.similarity, second.delay_ms);
  }
  json.add("]");
}

void add_robot(Json& json, const RobotFigures& robot, std::uint64_t since_ms,
               RobotFigures::Time now) {
  json.add(R"({{"robot":"{}","session":"{}","state":"{}","connections":{},)"
           R"("frames":{},"bytes":{},"drops":{},"frame_rate":{:.2f},)",
           robot.info().robot_id, robot.info().session_id, robot.state(), robot.connections(),
           robot.frames(), robot.bytes(), robot.drops(), robot.frame_rate(now));
  if (const auto age = robot.timeline().age(now)) json.add(R"("age_s":{:.3f},)", to_seconds(*age));
  if (const FramePtr& frame = robot.newest()) {
    json.add(R"("image":{{"sequence":{},"width":{},"height":{},"is_stereo":{}}},)", frame->sequence,
             frame->width_px, frame->height_px, frame->is_stereo());
  }
  if (robot.report()) add_report(json, *robot.report(), to_seconds(now - robot.report_time()));
  add_timeline(json, robot, since_ms, now);
  json.add("}}");
}

}  // namespace

std::string to_json(const Figures& figures, std::uint64_t since_ms, RobotFigures::Time now) {
  Json json;
  json.add(R"({{"version":"{}","clock_ms":{},"robots":[)", ORBBUF_VERSION, to_ms(now));
  for (const auto& [id, robot] : figures.robots()) {
    json.separate();
    add_robot(json, *robot, since_ms, now);
  }
  json.add("]}}\n");
  return std::move(json).take();
}

}  // namespace orbbuf
