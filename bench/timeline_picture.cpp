// SPDX-License-Identifier: Apache-2.0
#include "bench/timeline_picture.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

namespace orbbuf::bench {
namespace {

constexpr int kWidth = 1400;
constexpr int kLeft = 70;
constexpr int kRight = 30;
constexpr int kPanel = 220;  // height of one session's part
constexpr int kTicks = 40;   // of it, the strip of ticks
constexpr int kCurve = 110;  // and the curve
constexpr int kTop = 34;     // title of a panel
constexpr int kFooter = 30;  // the axis of time

const cv::Scalar kPaper(255, 255, 255);
const cv::Scalar kInk(60, 60, 60);
const cv::Scalar kGrid(225, 225, 225);
const cv::Scalar kDown(225, 235, 250);
const cv::Scalar kDelivered(110, 150, 40);
const cv::Scalar kDropped(50, 50, 215);
const cv::Scalar kLine(180, 100, 30);

class Canvas {
 public:
  Canvas(const std::vector<SessionOutcome>& sessions, const Outage& outage)
      : outage_(outage),
        image_(static_cast<int>(sessions.size()) * kPanel + kFooter, kWidth, CV_8UC3, kPaper) {
    for (const SessionOutcome& session : sessions) {
      for (const FrameOutcome& frame : session.frames) {
        begin_s_ = std::min(begin_s_, frame.capture_time_s);
        end_s_ = std::max(end_s_, frame.capture_time_s);
        top_ = std::max(top_, frame.similarity);
      }
    }
  }

  void draw(const SessionOutcome& session, int panel) {
    const int y = panel * kPanel;
    text(fmt::format("{}: {} captured, {} delivered, {} dropped, longest gap {} frames, smallest "
                     "similarity {}",
                     session.label, session.frames.size(), session.delivered(), session.dropped(),
                     session.longest_gap(), session.smallest_similarity()),
         {kLeft, y + 22}, 0.5);
    shade_outage(y + kTop, y + kTop + kTicks + 10 + kCurve);
    draw_ticks(session, y + kTop);
    draw_curve(session, y + kTop + kTicks + 10);
  }

  void draw_axis() {
    const int y = image_.rows - kFooter;
    const int whole_s = static_cast<int>(end_s_ - begin_s_);
    for (int t = 0; t <= whole_s; t += whole_s > 60 ? 10 : 1) {
      text(std::to_string(t), {x(begin_s_ + t) - 5, y + 14}, 0.4);
    }
    text("capture time, s", {kWidth - 150, y + 27}, 0.4);
  }

  const cv::Mat& image() const { return image_; }

 private:
  int x(double time_s) const {
    const double share = (time_s - begin_s_) / std::max(end_s_ - begin_s_, 1e-3);
    return kLeft + static_cast<int>(std::lround(share * (kWidth - kLeft - kRight)));
  }

  void text(const std::string& words, cv::Point at, double size) {
    cv::putText(image_, words, at, cv::FONT_HERSHEY_SIMPLEX, size, kInk, 1, cv::LINE_AA);
  }

  void shade_outage(int top, int bottom) {
    if (outage_.end_s <= outage_.begin_s) return;
    cv::rectangle(image_, {x(outage_.begin_s), top}, {x(outage_.end_s), bottom}, kDown, cv::FILLED);
    text("link down", {x(outage_.begin_s) + 4, bottom - 4}, 0.4);
  }

  void draw_ticks(const SessionOutcome& session, int y) {
    for (const FrameOutcome& frame : session.frames) {
      const int column = x(frame.capture_time_s);
      if (frame.is_delivered) {
        cv::line(image_, {column, y}, {column, y + kTicks}, kDelivered, 1);
      } else {
        cv::line(image_, {column, y + kTicks * 2 / 3}, {column, y + kTicks}, kDropped, 1);
      }
    }
  }

  void draw_curve(const SessionOutcome& session, int y) {
    const auto row = [&](int similarity) {
      return y + kCurve - similarity * kCurve / std::max(top_, 1);
    };
    for (int level = 0; level <= top_; level += 100) {
      cv::line(image_, {kLeft, row(level)}, {kWidth - kRight, row(level)}, kGrid, 1);
      text(std::to_string(level), {30, row(level) + 4}, 0.4);
    }
    const FrameOutcome* last = nullptr;
    for (const FrameOutcome& frame : session.frames) {
      if (frame.similarity < 0) continue;
      if (last) {
        cv::line(image_, {x(last->capture_time_s), row(last->similarity)},
                 {x(frame.capture_time_s), row(frame.similarity)}, kLine, 1, cv::LINE_AA);
      }
      last = &frame;
    }
  }

  Outage outage_;
  cv::Mat image_;
  double begin_s_ = 1e300;
  double end_s_ = -1e300;
  int top_ = 0;
};

}  // namespace

void draw_timelines(const std::vector<SessionOutcome>& sessions, const Outage& outage,
                    const std::filesystem::path& png) {
  Canvas canvas(sessions, outage);
  for (std::size_t i = 0; i < sessions.size(); ++i) canvas.draw(sessions[i], static_cast<int>(i));
  canvas.draw_axis();
  if (!cv::imwrite(png.string(), canvas.image())) {
    throw std::runtime_error("cannot write " + png.string());
  }
}

}  // namespace orbbuf::bench
