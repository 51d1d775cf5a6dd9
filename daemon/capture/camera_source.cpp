// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_source.hpp"

#include <poll.h>

#include <algorithm>
#include <array>
#include <ctime>
#include <limits>
#include <stdexcept>
#include <utility>

#include "common/event_fd.hpp"
#include "common/seconds.hpp"
#include "common/watched_thread.hpp"

namespace orbbuf {
namespace {

constexpr std::int64_t kShortestSleepNs = 10'000'000;  // less is how far off a reading may be
constexpr std::uint32_t kLargestGap = 1U << 31;        // beyond that, it is a step back

std::int64_t now_ns(clockid_t clock) {
  timespec now{};
  ::clock_gettime(clock, &now);
  return now.tv_sec * 1'000'000'000LL + now.tv_nsec;
}

using namespace std::chrono_literals;
using std::chrono::duration;
using std::chrono::duration_cast;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr auto kFirstFrame = 5s;  // some cameras take seconds to start
constexpr milliseconds kFirstBackoff = 100ms;
constexpr milliseconds kLongestBackoff = 2s;

std::string describe(const CameraMode& mode) {
  return fmt::format("{} {}x{} px, {}", to_string(mode.format), mode.width_px, mode.height_px,
                     mode.fps > 0 ? fmt::format("{:.4g} fps", mode.fps) : "rate unknown");
}

}  // namespace

ClockReading read_clocks() {
  ClockReading closest;
  std::int64_t least_ns = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < 5; ++i) {
    const auto before_ns = now_ns(CLOCK_MONOTONIC);
    const auto utc_ns = now_ns(CLOCK_REALTIME);
    const auto since_boot_ns = now_ns(CLOCK_BOOTTIME);
    const auto taken_ns = now_ns(CLOCK_MONOTONIC) - before_ns;
    if (taken_ns >= least_ns) continue;
    least_ns = taken_ns;
    const auto middle_ns = before_ns + taken_ns / 2;
    closest = {middle_ns, utc_ns, since_boot_ns - middle_ns};
  }
  return closest;
}

bool CaptureClock::follow(const ClockReading& now) {
  const std::int64_t slept_ns = now.asleep_ns - asleep_ns_;
  if (is_started_ && slept_ns < kShortestSleepNs) return false;
  offset_ns_ = is_started_ ? offset_ns_ + slept_ns : now.utc_ns - now.monotonic_ns;
  asleep_ns_ = now.asleep_ns;
  is_started_ = true;
  return true;
}

std::uint32_t GapCounter::missed_before(std::uint32_t sequence) {
  const std::uint32_t step = is_started_ ? sequence - last_ : 1;
  is_started_ = true;
  last_ = sequence;
  return step == 0 || step >= kLargestGap ? 0 : step - 1;
}

CameraSource::CameraSource(OpenCamera open_camera, std::string name, double fps)
    : open_camera_(std::move(open_camera)),
      name_(std::move(name)),
      fps_(fps),
      stop_event_(make_event_fd()),
      stamps_(fmt::format("camera {}", name_), kFateOfImages) {
  stamps_.expect_delay(0);
  open();
}

CameraSource::~CameraSource() {
  log_info(
      "camera {}: {} frames, {} missed by the camera, {} corrupt, {} with stamps that do not fit, "
      "reopened {} times",
      name_, frames_, missed_, corrupt_, stamps_.misfits(), reopened_);
}

std::optional<RawFrame> CameraSource::next(std::stop_token stop) {
  const std::stop_callback wake(stop, [this] { ::eventfd_write(stop_event_.get(), 1); });
  while (!stop.stop_requested()) {
    beat();
    if (!stream_) {
      if (Clock::now() < deadline_) {
        wait_until(deadline_, false);
      } else {
        reopen();
      }
    } else if (auto frame = take()) {
      return frame;
    } else if (stream_) {
      wait_until(deadline_, true);
    }
  }
  return std::nullopt;
}

/// The frame that the driver has ready, if any. May give up the stream.
std::optional<RawFrame> CameraSource::take() {
  const auto buffer = stream_->borrow();
  if (!buffer) {
    give_up(buffer.error().text);
    return std::nullopt;
  }
  if (!buffer.value()) {
    if (Clock::now() >= deadline_) {
      give_up(fmt::format("no frame for {:.1f} s", to_seconds(Clock::now() - waiting_since_)));
    }
    return std::nullopt;
  }
  auto frame = frame_of(*buffer.value());
  if (is_lost_) greet();
  opened_ = 0;
  ++frames_;
  await_frame_for(longest_pause());
  if (const auto error = stream_->give_back(*buffer.value())) give_up(error->text);
  return frame;
}

RawFrame CameraSource::frame_of(const CameraBuffer& buffer) {
  count_missed(buffer.sequence);
  RawFrame frame;
  if (buffer.is_corrupt) {
    ++corrupt_;
    frame.defect = "the camera's driver marked the image as corrupt";
  } else {
    frame = unpack(stream_->mode(), buffer.data, buffer.chroma);
    if (!frame.defect.empty()) ++corrupt_;
  }
  frame.exposure_ns = buffer.exposure_ns;
  const auto now = read_clocks();
  if (clock_.follow(now)) {
    log_info("camera {}: capture time = monotonic clock + {} ns", name_, clock_.offset_ns());
  }
  frame.monotonic_ns =
      std::min(stamps_.time_of(buffer.stamp_ns, now.monotonic_ns), now.monotonic_ns);
  frame.capture_time_ns = clock_.utc_ns(frame.monotonic_ns);
  return frame;
}

void CameraSource::count_missed(std::uint32_t sequence) {
  const auto missed = gaps_.missed_before(sequence);
  missed_ += missed;
  if (missed == 0 || !gap_log_.lets_through()) return;
  log_warn("camera {}: {} frames missed by the camera, {} in all (not logged again for 10 s)",
           name_, missed, missed_);
}

void CameraSource::open() {
  auto stream = open_camera_();
  const CameraMode& mode = stream->mode();
  if (!first_mode_) first_mode_ = mode;
  if (mode.width_px != first_mode_->width_px || mode.height_px != first_mode_->height_px) {
    throw std::runtime_error(
        fmt::format("its mode is now {}, not {}", describe(mode), describe(*first_mode_)));
  }
  stream_ = std::move(stream);
  ++opened_;
  await_frame_for(kFirstFrame);
  gaps_.start();
}

void CameraSource::reopen() {
  backoff_ = std::clamp(2 * backoff_, kFirstBackoff, kLongestBackoff);
  try {
    open();
    return;
  } catch (const CameraGone& error) {
    log_debug("camera {}: still missing: {}", name_, error.what());
  } catch (const std::runtime_error& error) {
    if (error.what() != why_shut_) {
      log_warn("camera {}: cannot reopen it: {}; retrying", name_, error.what());
    }
    why_shut_ = error.what();
  }
  deadline_ = Clock::now() + backoff_;
}

void CameraSource::give_up(const std::string& why) {
  if (is_lost_) {
    log_debug("camera {}: lost again: {}", name_, why);
  } else {
    log_warn("camera {}: lost: {}; reopening it", name_, why);
    lost_at_ = Clock::now();
    why_shut_.clear();
  }
  if (!is_lost_ && waiting_since_ - delivers_since_ > kLongestBackoff) backoff_ = 0ms;
  is_lost_ = true;
  if (opened_ == kMostInVain) ask_for_help(why);
  stream_.reset();  // may take as long as the driver waits for a camera that does not answer
  deadline_ = Clock::now() + backoff_;
}

void CameraSource::ask_for_help(const std::string& why) const {
  const auto reset = stream_->reset_command();
  log_error(
      "camera {}: the camera answers but sends nothing: opened {} times in a row, no frame ({}); "
      "unplug it and plug it in again{}; retrying",
      name_, opened_, why, reset.empty() ? "" : ", or reset its USB port: " + reset);
}

void CameraSource::greet() {
  is_lost_ = false;
  delivers_since_ = Clock::now();
  ++reopened_;
  log_info("{}: recovered after {:.1f} s", description(), to_seconds(Clock::now() - lost_at_));
}

void CameraSource::await_frame_for(nanoseconds limit) {
  waiting_since_ = Clock::now();
  deadline_ = waiting_since_ + limit;
}

/// Ends early for a stop, to beat, and, if `for_frame`, for a frame or the driver's failure.
void CameraSource::wait_until(Clock::time_point deadline, bool for_frame) {
  const auto left = std::min<milliseconds>(
      duration_cast<milliseconds>(deadline - Clock::now()) + 1ms, kBeatInterval);
  std::array<pollfd, 2> events = {
      {{stop_event_.get(), POLLIN, 0}, {for_frame ? stream_->fd() : -1, POLLIN, 0}}};
  ::poll(events.data(), events.size(), static_cast<int>(std::max(left, 0ms).count()));
}

nanoseconds CameraSource::frame_time() const {
  const double fps = stream_ && stream_->mode().fps > 0 ? stream_->mode().fps : fps_;
  return duration_cast<nanoseconds>(duration<double>(1 / fps));
}

nanoseconds CameraSource::longest_pause() const { return 1s + 3 * frame_time(); }

std::string CameraSource::description() const {
  if (!stream_) return fmt::format("camera {}", name_);
  return fmt::format("camera {}: {}", stream_->description(), describe(stream_->mode()));
}

}  // namespace orbbuf
