// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "common/sample.hpp"

namespace orbbuf {

/// How an element lies in the scans of a buffer of the kernel's Industrial I/O (IIO).
struct IioFormat {
  bool is_big_endian = false;
  bool is_signed = false;
  unsigned bits = 0;
  unsigned bytes = 0;  ///< that it is stored in: 1, 2, 4 or 8
  unsigned shift = 0;  ///< bits below it

  std::int64_t value_at(const std::uint8_t* bytes) const;
  friend bool operator==(const IioFormat&, const IioFormat&) = default;
};

/// Reads a file `*_type` of sysfs, such as `le:s16/32>>4`. Nothing: it is no such text, or more
/// than one value.
std::optional<IioFormat> parse_iio_format(std::string_view type);

/// Where the kernel shows its devices; another place in tests.
struct IioRoots {
  std::filesystem::path devices = "/sys/bus/iio/devices";
  std::filesystem::path nodes = "/dev";
};

/// A gyroscope, an accelerometer or both, as a device of IIO with a buffer. Sets the buffer up, by
/// the files in sysfs, and reads its scans. Reentrant.
class IioDevice {
 public:
  /// `name` is that in its file `name`, or that of its folder, iio:deviceN. A buffer that is on is
  /// taken as it is; one that is off is switched on here, and off at the end. Throws
  /// std::runtime_error, saying what was tried and why not.
  IioDevice(const std::string& name, const IioRoots& roots);
  ~IioDevice();
  IioDevice(const IioDevice&) = delete;
  IioDevice& operator=(const IioDevice&) = delete;

  /// Its node, from which whole scans are read.
  const std::filesystem::path& node() const { return node_; }
  bool has_gyroscope() const { return gyroscope_.has_value(); }
  bool has_accelerometer() const { return accelerometer_.has_value(); }
  std::size_t scan_bytes() const { return scan_bytes_; }
  /// A scan, in the axes that its mount matrix leads to. The time is by the monotonic clock; what
  /// the device does not have is 0.
  Sample read(const std::uint8_t* scan) const;

 private:
  struct Element {
    std::size_t place = 0;  // in a scan
    IioFormat format;
  };
  struct Axis {
    Element element;
    double offset = 0;
    double scale = 1;
  };
  struct Sensor {
    std::array<Axis, 3> axes;
    std::array<double, 9> mount;  // row by row

    std::array<double, 3> read(const std::uint8_t* scan) const;
  };

  void choose_elements();
  void lay_out();
  std::optional<Sensor> find_sensor(const std::string& type) const;

  const std::filesystem::path folder_;
  const std::filesystem::path node_;
  bool is_ours_ = false;  // switched on here
  std::map<std::string, Element> elements_;
  std::size_t scan_bytes_ = 0;
  std::optional<Sensor> gyroscope_;
  std::optional<Sensor> accelerometer_;
};

/// For a person: a line for each gyroscope and accelerometer, `bmi160 (iio:device0): ...`.
std::string list_iio_devices(const IioRoots& roots = {});

}  // namespace orbbuf
