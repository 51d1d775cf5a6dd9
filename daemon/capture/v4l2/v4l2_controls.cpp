// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/v4l2/v4l2_controls.hpp"

#include <fmt/format.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <stdexcept>

#include "daemon/capture/v4l2/v4l2_device.hpp"

namespace orbbuf {
namespace {

constexpr __u32 kNext = V4L2_CTRL_FLAG_NEXT_CTRL;

template <class Byte, std::size_t Size>
std::string text_of(const Byte (&bytes)[Size]) {
  return {bytes, std::find(bytes, bytes + Size, 0)};
}

bool can_be_set(const v4l2_query_ext_ctrl& query) {
  constexpr __u32 kNot =
      V4L2_CTRL_FLAG_DISABLED | V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_HAS_PAYLOAD;
  if ((query.flags & kNot) != 0) return false;
  switch (query.type) {
    case V4L2_CTRL_TYPE_INTEGER:
    case V4L2_CTRL_TYPE_BOOLEAN:
    case V4L2_CTRL_TYPE_MENU:
    case V4L2_CTRL_TYPE_BUTTON:
    case V4L2_CTRL_TYPE_INTEGER64:
    case V4L2_CTRL_TYPE_BITMASK:
    case V4L2_CTRL_TYPE_INTEGER_MENU:
      return true;
    default:
      return false;
  }
}

bool is_switch(const v4l2_query_ext_ctrl& query) {
  return query.type == V4L2_CTRL_TYPE_BOOLEAN || query.type == V4L2_CTRL_TYPE_MENU;
}

std::vector<std::string> menu_of(const V4l2Device& device, const v4l2_query_ext_ctrl& query) {
  std::vector<std::string> menu;
  const bool is_text = query.type == V4L2_CTRL_TYPE_MENU;
  if (!is_text && query.type != V4L2_CTRL_TYPE_INTEGER_MENU) return menu;
  for (std::int64_t index = query.minimum; index <= query.maximum; ++index) {
    v4l2_querymenu entry{};
    entry.id = query.id;
    entry.index = static_cast<__u32>(index);
    if (device.call(VIDIOC_QUERYMENU, &entry) != 0) continue;  // drivers leave entries out
    menu.push_back(
        fmt::format("{} {}", index, is_text ? text_of(entry.name) : std::to_string(+entry.value)));
  }
  return menu;
}

int set_one(const V4l2Device& device, const CameraControl& control, double value) {
  v4l2_ext_control entry{};
  entry.id = control.id;
  if (control.is_wide) {
    entry.value64 = static_cast<__s64>(value);
  } else {
    entry.value = static_cast<__s32>(value);
  }
  v4l2_ext_controls request{};
  request.which = V4L2_CTRL_WHICH_CUR_VAL;
  request.count = 1;
  request.controls = &entry;
  return device.call(VIDIOC_S_EXT_CTRLS, &request);
}

const CameraControl& find(const V4l2Device& device, const std::vector<CameraControl>& controls,
                          const std::string& name) {
  const auto found = std::ranges::find(controls, name, &CameraControl::name);
  if (found != controls.end()) return *found;
  std::vector<std::string_view> names(controls.size());
  std::ranges::transform(controls, names.begin(), &CameraControl::name);
  throw std::runtime_error(
      fmt::format("camera {}: no control {}; its controls: {}", device.path(), name,
                  names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
}

}  // namespace

std::string control_name(std::string_view driver_name) {
  std::string name;
  bool is_between = false;
  for (const char letter : driver_name) {
    const auto code = static_cast<unsigned char>(letter);
    if (std::isalnum(code) == 0) {
      is_between = !name.empty();
      continue;
    }
    if (is_between) name += '_';
    is_between = false;
    name += static_cast<char>(std::tolower(code));
  }
  return name;
}

std::string why_refused(const CameraControl& control, double value) {
  const auto is_entry = [value](const std::string& entry) {
    return entry.starts_with(fmt::format("{} ", value));
  };
  if (!control.menu.empty()) {
    if (std::ranges::any_of(control.menu, is_entry)) return "";
    return fmt::format("control {}: must be one of {}, got {}", control.name,
                       fmt::join(control.menu, ", "), value);
  }
  const bool is_inside =
      value >= static_cast<double>(control.min) && value <= static_cast<double>(control.max);
  if (is_inside && value == std::trunc(value)) return "";
  return fmt::format("control {}: must be {} to {} in steps of {} (default {}), got {}",
                     control.name, control.min, control.max, control.step, control.fallback, value);
}

std::vector<CameraControl> list_controls(const V4l2Device& device) {
  std::vector<CameraControl> controls;
  v4l2_query_ext_ctrl query{};
  query.id = kNext;
  for (; device.call(VIDIOC_QUERY_EXT_CTRL, &query) == 0; query.id |= kNext) {
    if (!can_be_set(query)) continue;
    CameraControl control{query.id,
                          control_name(text_of(query.name)),
                          query.minimum,
                          query.maximum,
                          static_cast<std::int64_t>(query.step),
                          query.default_value,
                          menu_of(device, query),
                          query.type == V4L2_CTRL_TYPE_INTEGER64,
                          is_switch(query)};
    if (query.type == V4L2_CTRL_TYPE_BITMASK) control.min = 0;
    controls.push_back(std::move(control));
  }
  return controls;
}

std::vector<std::string> setting_order(const std::vector<CameraControl>& controls,
                                       const CameraControls& values) {
  std::vector<std::string> names(values.size());
  std::ranges::transform(values, names.begin(), &CameraControls::value_type::first);
  std::stable_partition(names.begin(), names.end(), [&](const std::string& name) {
    return std::ranges::find(controls, name, &CameraControl::name)->is_switch;
  });
  return names;
}

void set_controls(const V4l2Device& device, const CameraControls& values) {
  if (values.empty()) return;
  const auto controls = list_controls(device);
  for (const auto& [name, value] : values) {
    const std::string why = why_refused(find(device, controls, name), value);
    if (!why.empty()) throw std::runtime_error(fmt::format("camera {}: {}", device.path(), why));
  }
  auto waiting = setting_order(controls, values);
  while (!waiting.empty()) {
    int error = 0;
    std::string refused;
    const auto accepted = std::erase_if(waiting, [&](const std::string& name) {
      const int status = set_one(device, find(device, controls, name), values.at(name));
      if (status != 0) {
        error = status;
        refused = name;
      }
      return status == 0;
    });
    if (accepted != 0) continue;
    device.fail("set control " + refused, error,
                error == EACCES ? "; the control is inactive: turn off its automatic mode" : "");
  }
}

}  // namespace orbbuf
