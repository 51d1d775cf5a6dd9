// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/iio_device.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <regex>
#include <set>
#include <stdexcept>

#include "common/error.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLength = "1024";  // scans in the kernel, for a moment without us
constexpr std::array kAxes = {"x", "y", "z"};

/// Of a file of sysfs, without its line end; empty if there is none.
std::string text_of(const fs::path& path) {
  std::string text;
  std::getline(std::ifstream(path), text);
  return text;
}

/// `fallback`: there is no such file.
double number_of(const fs::path& path, double fallback) {
  std::ifstream file(path);
  if (!file) return fallback;
  double number = 0;
  if (!(file >> number)) throw std::runtime_error("cannot read a number from " + path.string());
  return number;
}

void write(const fs::path& path, std::string_view text) {
  const UniqueFd file(::open(path.c_str(), O_WRONLY | O_TRUNC | O_CLOEXEC));
  if (!file || ::write(file.get(), text.data(), text.size()) < 0) {
    throw_system_error(fmt::format("cannot write {} to {}", text, path.string()));
  }
}

fs::path find_folder(const std::string& name, const IioRoots& roots) {
  std::error_code absent;
  for (const fs::directory_entry& entry : fs::directory_iterator(roots.devices, absent)) {
    if (entry.path().filename() == name || text_of(entry.path() / "name") == name) {
      return entry.path();
    }
  }
  throw std::runtime_error("no IIO device " + name + "; orbbufd --list-imus prints those it knows");
}

std::array<double, 9> mount_matrix(const fs::path& folder, const std::string& type) {
  for (const auto& name : {"in_" + type + "_mount_matrix", std::string("in_mount_matrix"),
                           std::string("mount_matrix")}) {
    std::string text = text_of(folder / name);
    std::ranges::replace_if(
        text, [](char letter) { return letter == ',' || letter == ';'; }, ' ');
    std::istringstream numbers(text);
    std::array<double, 9> matrix{};
    if (std::ranges::all_of(matrix, [&](double& each) { return bool(numbers >> each); })) {
      return matrix;
    }
  }
  return {1, 0, 0, 0, 1, 0, 0, 0, 1};
}

}  // namespace

std::int64_t IioFormat::value_at(const std::uint8_t* from) const {
  std::uint64_t raw = 0;
  for (unsigned i = 0; i < bytes; ++i) {
    raw |= std::uint64_t{from[is_big_endian ? bytes - 1 - i : i]} << 8 * i;
  }
  const unsigned above = 64 - bits;
  raw = raw >> shift << above;
  return is_signed ? static_cast<std::int64_t>(raw) >> above
                   : static_cast<std::int64_t>(raw >> above);
}

std::optional<IioFormat> parse_iio_format(std::string_view type) {
  static const std::regex form("(le|be):([su])(\\d{1,2})/(8|16|32|64)>>(\\d{1,2})");
  std::cmatch parts;
  if (!std::regex_match(type.begin(), type.end(), parts, form)) return std::nullopt;
  const auto number = [&](std::size_t part) {
    return static_cast<unsigned>(std::stoul(parts.str(part)));
  };
  const IioFormat format{parts.str(1) == "be", parts.str(2) == "s", number(3), number(4) / 8,
                         number(5)};
  const bool fits = format.bits > 0 && format.bits + format.shift <= 8 * format.bytes;
  return fits ? std::optional(format) : std::nullopt;
}

IioDevice::IioDevice(const std::string& name, const IioRoots& roots)
    : folder_(find_folder(name, roots)), node_(roots.nodes / folder_.filename()) {
  is_ours_ = text_of(folder_ / "buffer/enable") != "1";
  if (is_ours_) choose_elements();
  lay_out();
  if (const auto clock = text_of(folder_ / "current_timestamp_clock"); clock != "monotonic") {
    throw std::runtime_error(fmt::format("{}: its clock is {}, not monotonic", folder_.string(),
                                         clock.empty() ? "not known" : clock));
  }
  if (!elements_.contains("in_timestamp")) {
    throw std::runtime_error(folder_.string() + ": its scans have no in_timestamp");
  }
  gyroscope_ = find_sensor("anglvel");
  accelerometer_ = find_sensor("accel");
  if (!is_ours_) return;
  write(folder_ / "buffer/length", kLength);
  write(folder_ / "buffer/enable", "1");
}

IioDevice::~IioDevice() {
  if (!is_ours_) return;
  std::ofstream(folder_ / "buffer/enable") << 0;  // else the device goes on measuring
}

void IioDevice::choose_elements() {
  const auto take = [this](const std::string& element) {
    const auto path = folder_ / "scan_elements" / (element + "_en");
    if (fs::exists(path)) write(path, "1");
  };
  for (const char* const axis : kAxes) {
    take(std::string("in_anglvel_") + axis);
    take(std::string("in_accel_") + axis);
  }
  take("in_timestamp");
  write(folder_ / "current_timestamp_clock", "monotonic");
}

/// As the kernel does: by their index, each at a multiple of its size, and the scan a multiple of
/// the largest.
void IioDevice::lay_out() {
  constexpr std::string_view kEnd = "_en";
  std::map<int, std::string> enabled;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / "scan_elements")) {
    std::string name = entry.path().filename();
    if (!name.ends_with(kEnd) || text_of(entry) != "1") continue;
    name.resize(name.size() - kEnd.size());
    enabled[static_cast<int>(number_of(folder_ / "scan_elements" / (name + "_index"), 0))] = name;
  }
  std::size_t largest = 1;
  const auto align = [this](std::size_t bytes) {
    scan_bytes_ = (scan_bytes_ + bytes - 1) / bytes * bytes;
  };
  for (const auto& [index, name] : enabled) {
    const auto type = text_of(folder_ / "scan_elements" / (name + "_type"));
    const auto format = parse_iio_format(type);
    if (!format)
      throw std::runtime_error(fmt::format("{}: {} is {}", folder_.string(), name, type));
    align(format->bytes);
    elements_[name] = {scan_bytes_, *format};
    scan_bytes_ += format->bytes;
    largest = std::max<std::size_t>(largest, format->bytes);
  }
  align(largest);
}

std::optional<IioDevice::Sensor> IioDevice::find_sensor(const std::string& type) const {
  Sensor sensor{{}, mount_matrix(folder_, type)};
  for (std::size_t i = 0; i < kAxes.size(); ++i) {
    const std::string all = "in_" + type;
    const std::string name = all + '_' + kAxes.at(i);
    const auto element = elements_.find(name);
    if (element == elements_.end()) return std::nullopt;
    const auto number = [&](const char* what, double fallback) {
      return number_of(folder_ / (name + what), number_of(folder_ / (all + what), fallback));
    };
    sensor.axes.at(i) = {element->second, number("_offset", 0), number("_scale", 1)};
  }
  return sensor;
}

std::array<double, 3> IioDevice::Sensor::read(const std::uint8_t* scan) const {
  std::array<double, 3> value{};
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const auto& [element, offset, scale] = axes.at(i);
    const auto raw = static_cast<double>(element.format.value_at(scan + element.place));
    for (std::size_t row = 0; row < value.size(); ++row) {
      value.at(row) += mount.at(3 * row + i) * (raw + offset) * scale;
    }
  }
  return value;
}

Sample IioDevice::read(const std::uint8_t* scan) const {
  const Element& time = elements_.at("in_timestamp");
  Sample sample{time.format.value_at(scan + time.place), {}, {}};
  if (gyroscope_) sample.angular_velocity = gyroscope_->read(scan);
  if (accelerometer_) sample.linear_acceleration = accelerometer_->read(scan);
  return sample;
}

std::string list_iio_devices(const IioRoots& roots) {
  std::set<std::string> lines;
  std::error_code absent;
  for (const fs::directory_entry& entry : fs::directory_iterator(roots.devices, absent)) {
    const auto has = [&](const char* type) {
      return fs::exists(entry.path() / "scan_elements" / fmt::format("in_{}_x_en", type));
    };
    if (!has("anglvel") && !has("accel")) continue;
    std::string rate = text_of(entry.path() / "sampling_frequency");
    for (const char* const type : {"anglvel", "accel"}) {
      if (rate.empty())
        rate = text_of(entry.path() / fmt::format("in_{}_sampling_frequency", type));
    }
    lines.insert(fmt::format("{} ({}):{}{}{}\n", text_of(entry.path() / "name"),
                             entry.path().filename().string(), has("anglvel") ? " gyroscope" : "",
                             has("accel") ? " accelerometer" : "",
                             rate.empty() ? "" : " " + rate + " Hz"));
  }
  return lines.empty() ? "no inertial sensor is a device of IIO here\n"
                       : fmt::format("{}", fmt::join(lines, ""));
}

}  // namespace orbbuf
