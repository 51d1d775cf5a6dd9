// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/libcamera/libcamera_controls.hpp"

#include <fmt/format.h>
#include <libcamera/control_ids.h>
#include <libcamera/controls.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <stdexcept>

namespace orbbuf {
namespace {

using libcamera::ControlId;
using libcamera::ControlInfo;
using libcamera::ControlInfoMap;
using libcamera::ControlValue;

/// A control takes an array: newer releases tell, of 0.0.3 these are all. Set to one number it
/// would end the process by an assertion.
template <class Id>
bool is_array(const Id& id) {
  if constexpr (requires { id.isArray(); }) {
    return id.isArray();
  } else {
    constexpr std::array<std::string_view, 4> kArrays = {"ColourGains", "ColourCorrectionMatrix",
                                                         "FrameDurationLimits", "AfWindows"};
    return std::ranges::find(kArrays, id.name()) != kArrays.end();
  }
}

/// Calls `use` with a value of the C++ type that stands for `type`; false: it is not one number.
template <class Use>
bool with_number(libcamera::ControlType type, Use use) {
  switch (type) {
    case libcamera::ControlTypeBool:
      return use(bool{}), true;
    case libcamera::ControlTypeByte:
      return use(std::uint8_t{}), true;
    case libcamera::ControlTypeInteger32:
      return use(std::int32_t{}), true;
    case libcamera::ControlTypeInteger64:
      return use(std::int64_t{}), true;
    case libcamera::ControlTypeFloat:
      return use(float{}), true;
    default:
      return false;
  }
}

bool can_be_set(const ControlId& id) {
  return with_number(id.type(), [](auto /*zero*/) {}) && !is_array(id);
}

std::optional<double> number_of(const ControlValue& value) {
  std::optional<double> number;
  if (value.isArray()) return number;
  with_number(value.type(),
              [&](auto zero) { number = static_cast<double>(value.get<decltype(zero)>()); });
  return number;
}

ControlValue value_of(libcamera::ControlType type, double number) {
  ControlValue value;
  with_number(type, [&](auto zero) { value.set(static_cast<decltype(zero)>(number)); });
  return value;
}

/// Whether the type can hold the number at all; of some controls no range is known.
bool fits(libcamera::ControlType type, double number) {
  constexpr double kMost = 1e18;  // of 64 bits
  bool is_held = false;
  with_number(type, [&](auto zero) {
    using Limits = std::numeric_limits<decltype(zero)>;
    is_held = !Limits::is_integer || (number == std::trunc(number) && std::abs(number) <= kMost &&
                                      number >= static_cast<double>(Limits::min()) &&
                                      number <= static_cast<double>(Limits::max()));
  });
  return is_held;
}

/// `0 to 66666, default 20000`, or the values there are, as far as the camera says.
std::string describe(const ControlId& id, const ControlInfo& info) {
  std::string text = "any number";
  const auto min = number_of(info.min());
  const auto max = number_of(info.max());
  if (min && max) text = fmt::format("{:.6g} to {:.6g}", *min, *max);
  if (!info.values().empty() && id.type() != libcamera::ControlTypeBool) {
    std::vector<std::string> values;
    for (const ControlValue& value : info.values()) values.push_back(value.toString());
    text = fmt::format("{}", fmt::join(values, ", "));
  }
  const auto fallback = number_of(info.def());
  return fallback ? fmt::format("{}, default {:.6g}", text, *fallback) : text;
}

bool accepts(const ControlId& id, const ControlInfo& info, double number) {
  if (!fits(id.type(), number)) return false;
  const auto min = number_of(info.min());
  const auto max = number_of(info.max());
  if (min && max && (number < *min || number > *max)) return false;
  const auto is_number = [number](const ControlValue& v) { return number_of(v) == number; };
  return info.values().empty() || std::ranges::any_of(info.values(), is_number);
}

/// Not by the map's own find(), which 0.0.3 does not survive where a camera has no controls at all.
ControlInfoMap::const_iterator find(const ControlInfoMap& offered, const ControlId& id) {
  return std::ranges::find_if(offered,
                              [&id](const auto& entry) { return entry.first->id() == id.id(); });
}

using Entry = std::pair<std::string, const ControlInfoMap::value_type*>;

/// By name, since libcamera has them in no order.
std::vector<Entry> settable(const ControlInfoMap& offered) {
  std::vector<Entry> entries;
  for (const auto& entry : offered) {
    if (!can_be_set(*entry.first)) continue;
    entries.emplace_back(libcamera_control_name(entry.first->name()), &entry);
  }
  std::ranges::sort(entries);
  return entries;
}

}  // namespace

std::string libcamera_control_name(std::string_view name) {
  std::string lower;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const auto letter = static_cast<unsigned char>(name[i]);
    const bool begins_word = i > 0 && std::isupper(letter) != 0 &&
                             std::isupper(static_cast<unsigned char>(name[i - 1])) == 0;
    if (begins_word) lower += '_';
    lower += static_cast<char>(std::tolower(letter));
  }
  return lower;
}

libcamera::ControlList control_list(const ControlInfoMap& offered,
                                    const std::map<std::string, double>& values) {
  libcamera::ControlList list(libcamera::controls::controls);
  const auto entries = settable(offered);
  for (const auto& [name, number] : values) {
    const auto found = std::ranges::find(entries, name, &Entry::first);
    if (found == entries.end()) {
      std::vector<std::string_view> names(entries.size());
      std::ranges::transform(entries, names.begin(), &Entry::first);
      throw std::runtime_error(
          fmt::format("no control {}; its controls: {}", name,
                      names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
    }
    const auto& [id, info] = *found->second;
    if (!accepts(*id, info, number)) {
      throw std::runtime_error(
          fmt::format("control {}: must be {}, got {}", name, describe(*id, info), number));
    }
    list.set(id->id(), value_of(id->type(), number));
  }
  return list;
}

double set_rate(libcamera::ControlList& list, const ControlInfoMap& offered, double fps) {
  const auto found = find(offered, libcamera::controls::FrameDurationLimits);
  if (found == offered.end()) return 0;
  double duration_us = 1e6 / fps;
  const auto min = number_of(found->second.min());
  const auto max = number_of(found->second.max());
  if (min && max && *min <= *max) duration_us = std::clamp(duration_us, *min, *max);
  const std::int64_t whole_us = std::llround(duration_us);
  const std::array<std::int64_t, 2> limits = {whole_us, whole_us};
  list.set(libcamera::controls::FrameDurationLimits,
           libcamera::Span<const std::int64_t, 2>(limits.data(), limits.size()));
  return 1e6 / static_cast<double>(whole_us);
}

void set_crop(libcamera::ControlList& list, const ControlInfoMap& offered, const Crop& crop) {
  const auto found = find(offered, libcamera::controls::ScalerCrop);
  const auto attempt = fmt::format("cannot crop its sensor to {}", to_string(crop));
  if (found == offered.end()) {
    throw std::runtime_error(attempt + ": the camera does not support cropping");
  }
  const libcamera::Rectangle part(crop.left_px, crop.top_px,
                                  static_cast<unsigned int>(crop.width_px),
                                  static_cast<unsigned int>(crop.height_px));
  const ControlValue& whole = found->second.max();
  if (whole.type() == libcamera::ControlTypeRectangle) {
    const auto bounds = whole.get<libcamera::Rectangle>();
    if (bounds.isNull() || part.boundedTo(bounds) == part) {
      list.set(libcamera::controls::ScalerCrop, part);
      return;
    }
    throw std::runtime_error(fmt::format("{}: the sensor is {}", attempt, bounds.toString()));
  }
  list.set(libcamera::controls::ScalerCrop, part);
}

std::vector<std::string> describe_controls(const ControlInfoMap& offered) {
  std::vector<std::string> lines;
  for (const auto& [name, entry] : settable(offered)) {
    lines.push_back(fmt::format("{}: {}", name, describe(*entry->first, entry->second)));
  }
  return lines;
}

}  // namespace orbbuf
