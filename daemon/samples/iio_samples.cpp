// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/iio_samples.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <cerrno>
#include <stdexcept>
#include <utility>

#include "common/error.hpp"
#include "common/log.hpp"

namespace orbbuf {
namespace {

int open_node(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) throw_system_error("cannot open " + path.string());
  return fd;
}

}  // namespace

IioSamples::Port::Port(boost::asio::io_context& main, const std::string& name,
                       const IioRoots& roots)
    : device(name, roots),
      node(main, open_node(device.node())),
      stamps(fmt::format("{} of {}", name, device.node().string()), "the scan is lost") {
  stamps.expect_delay(0);
}

IioSamples::IioSamples(boost::asio::io_context& main, const SampleStreamSettings& settings,
                       Take take, const IioRoots& roots)
    : name_(settings.name), take_(std::move(take)), watch_(main) {
  try {
    for (const std::string& name : settings.devices) ports_.emplace_back(main, name, roots);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(fmt::format("{}: {}", name_, error.what()));
  }
  const auto count = [this](bool (IioDevice::*has)() const) {
    return std::ranges::count_if(ports_, [has](const Port& port) { return (port.device.*has)(); });
  };
  if (count(&IioDevice::has_gyroscope) != 1 || count(&IioDevice::has_accelerometer) != 1) {
    throw std::runtime_error(
        fmt::format("{}: {}: expected one gyroscope and one accelerometer, each with x, y and z",
                    name_, fmt::join(settings.devices, ", ")));
  }
  for (Port& port : ports_) receive(port);
  watch();
}

/// The frames' times begin with the clock as it is now, which may have been set since the first
/// scan.
void IioSamples::on_frame(std::int64_t /*time_ns*/) {
  if (std::exchange(has_frames_, true)) return;
  for (Port& port : ports_) port.clock = {};
  pending_.clear();
  last_acceleration_.reset();
}

/// A device that is unplugged wakes no poll of its buffer, at least until Linux 6.1; a read fails.
void IioSamples::watch() {
  watch_.expires_after(std::chrono::seconds(1));
  watch_.async_wait([this, life = life()](const boost::system::error_code&) {
    if (life.expired()) return;
    for (Port& port : ports_) {
      if (::read(port.node.native_handle(), nullptr, 0) < 0 && errno == ENODEV) {
        return give_up(port, ENODEV);
      }
    }
    watch();
  });
}

void IioSamples::give_up(const Port& port, int error_number) {
  log_error("{}: {}; no more samples come", name_,
            system_error("read " + port.device.node().string(), error_number).text);
  watch_.cancel();
  for (Port& each : ports_) each.node.close();
}

void IioSamples::receive(Port& port) {
  port.node.async_read_some(
      boost::asio::buffer(port.scans),
      [this, &port, life = life()](const boost::system::error_code& error, std::size_t bytes) {
        if (life.expired()) return;
        if (error == boost::asio::error::operation_aborted) return;
        if (error) return give_up(port, error.value());
        const ClockReading now = read_clocks();
        port.clock.follow(now);
        const std::size_t step = port.device.scan_bytes();
        for (std::size_t at = 0; at + step <= bytes; at += step) {
          Sample sample = port.device.read(port.scans.data() + at);
          const auto time_ns = port.stamps.fit(sample.time_ns, now.monotonic_ns);
          sample.time_ns = time_ns ? port.clock.utc_ns(*time_ns) : 0;
          add(sample, port.device);
        }
        receive(port);
      });
}

/// One without a time is lost, which its stream counts.
void IioSamples::add(const Sample& sample, const IioDevice& device) {
  const bool is_lost = sample.time_ns == 0;
  if (device.has_gyroscope() && (device.has_accelerometer() || is_lost)) return take_(sample);
  if (is_lost) return;
  if (!device.has_gyroscope()) return interpolate(sample);
  pending_.push_back(sample);
  if (pending_.size() > kMostPending) pending_.pop_front();
}

void IioSamples::interpolate(const Sample& next) {
  const auto last = std::exchange(last_acceleration_, next);
  for (; !pending_.empty() && pending_.front().time_ns <= next.time_ns; pending_.pop_front()) {
    Sample sample = pending_.front();
    if (!last || sample.time_ns < last->time_ns || last->time_ns == next.time_ns) continue;
    const double share = static_cast<double>(sample.time_ns - last->time_ns) /
                         static_cast<double>(next.time_ns - last->time_ns);
    for (std::size_t i = 0; i < sample.linear_acceleration.size(); ++i) {
      sample.linear_acceleration.at(i) =
          std::lerp(last->linear_acceleration.at(i), next.linear_acceleration.at(i), share);
    }
    take_(sample);
  }
}

}  // namespace orbbuf
