// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <optional>
#include <string>

#include "daemon/capture/camera_source.hpp"
#include "daemon/samples/iio_device.hpp"
#include "daemon/samples/sample_source.hpp"

namespace orbbuf {

/// Takes samples from the buffers of the kernel's Industrial I/O: of one device with gyroscope and
/// accelerometer, or of one with each. Then a sample has the time of the gyroscope, and the
/// acceleration is interpolated at it, so it waits for the next of the accelerometer.
/// Times are those of the kernel, on the clock of a camera's frames (CaptureClock).
class IioSamples final : public SampleSource {
 public:
  /// Of the gyroscope, while the accelerometer gives nothing; then the oldest go.
  static constexpr std::size_t kMostPending = 10'000;

  /// Throws std::runtime_error, `NAME: ...`.
  IioSamples(boost::asio::io_context& main, const SampleStreamSettings& settings, Take take,
             const IioRoots& roots = {});
  void on_frame(std::int64_t time_ns) override;

 private:
  struct Port {
    Port(boost::asio::io_context& main, const std::string& name, const IioRoots& roots);

    IioDevice device;
    boost::asio::posix::stream_descriptor node;
    CaptureClock clock{};
    StampClock stamps;
    std::array<std::uint8_t, std::size_t{16} << 10U> scans{};
  };

  void receive(Port& port);
  void watch();
  void give_up(const Port& port, int error_number);
  void add(const Sample& sample, const IioDevice& device);
  void interpolate(const Sample& acceleration);

  const std::string name_;
  const Take take_;
  std::list<Port> ports_;
  boost::asio::steady_timer watch_;
  std::deque<Sample> pending_;  // of the gyroscope
  std::optional<Sample> last_acceleration_;
  bool has_frames_ = false;
};

}  // namespace orbbuf
