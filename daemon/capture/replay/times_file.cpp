// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/times_file.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <fstream>
#include <limits>
#include <map>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "common/decimal.hpp"
#include "common/log.hpp"
#include "common/text_lines.hpp"

namespace orbbuf {
namespace {

constexpr int kNanosecondDigits = 9;      // behind the point of a second
constexpr int kNanosecondDigitsOfMs = 6;  // behind the point of a millisecond

struct Line {
  int number = 0;
  std::vector<std::string> fields;
};

bool is_digit(char c) { return c >= '0' && c <= '9'; }

[[noreturn]] void fail(const std::filesystem::path& file, const std::string& why) {
  throw std::runtime_error("cannot read times from " + file.string() + ": " + why);
}

[[noreturn]] void fail(const std::filesystem::path& file, const Line& line,
                       const std::string& why) {
  fail(file, "line " + std::to_string(line.number) + ": " + why);
}

std::vector<Line> read_lines(const std::filesystem::path& file) {
  std::ifstream in(file);
  const bool has_commas = file.extension() == ".csv";
  std::vector<Line> lines;
  int number = 0;
  for (std::string text; std::getline(in, text);) {
    ++number;
    if (has_commas) std::ranges::replace(text, ',', ' ');
    const auto words = words_of(std::string_view(text).substr(0, text.find('#')));
    if (!words.empty()) lines.push_back({number, {words.begin(), words.end()}});
  }
  if (!in.eof()) fail(file, std::generic_category().message(errno));
  if (lines.empty()) fail(file, "the file has none");
  const auto count = lines.front().fields.size();
  for (const auto& line : lines) {
    if (line.fields.size() == count && count <= 3) continue;
    fail(file, line,
         std::to_string(line.fields.size()) +
             " fields; expected 1 to 3, the same number on every line");
  }
  return lines;
}

/// "2011-09-26" and "13:02:25.964389445", in UTC, as nanoseconds since 1970. Nothing if they are
/// no such time.
std::optional<std::int64_t> parse_date(const std::string& date, const std::string& time_of_day) {
  auto text = date + '-' + time_of_day;
  std::ranges::replace_if(
      text, [](char c) { return c == '-' || c == ':'; }, ' ');
  const auto words = words_of(text);
  if (words.size() != 6) return std::nullopt;
  std::array<int, 5> parts{};  // year to minute
  for (std::size_t i = 0; i < parts.size(); ++i) {
    parts.at(i) = parse_number<int>(words[i]).value_or(-1);
  }
  const auto [year, month, day, hour, minute] = parts;
  const std::chrono::year_month_day on(std::chrono::year(year),
                                       std::chrono::month(static_cast<unsigned>(month)),
                                       std::chrono::day(static_cast<unsigned>(day)));
  const auto seconds_ns = parse_decimal(words[5], kNanosecondDigits);
  constexpr int kLastYear = 2261;  // that 64 bits tell in nanoseconds
  const bool is_time = year >= 1970 && year <= kLastYear && on.ok() && hour >= 0 && hour < 24 &&
                       minute >= 0 && minute < 60 && seconds_ns && *seconds_ns < 61'000'000'000;
  if (!is_time) return std::nullopt;
  const std::chrono::nanoseconds since = std::chrono::sys_days(on).time_since_epoch() +
                                         std::chrono::hours(hour) + std::chrono::minutes(minute) +
                                         std::chrono::nanoseconds(*seconds_ns);
  return since.count();
}

/// Which field holds what; -1: none does.
struct FileLayout {
  std::string_view name;
  int time = 0;
  int image = -1;
  int id = -1;
  int exposure = -1;
  int digits = kNanosecondDigits;  // behind the point, down to a nanosecond
  bool is_date = false;            // and the time of day in the field behind it
};

FileLayout layout_of(const std::filesystem::path& file, const std::vector<Line>& lines) {
  const auto& fields = lines.front().fields;
  switch (fields.size()) {
    case 1:
      return {.name = "KITTI odometry"};
    case 2:
      if (parse_date(fields[0], fields[1])) return {.name = "KITTI raw", .is_date = true};
      if (file.extension() == ".csv") return {.name = "EuRoC", .image = 1, .digits = 0};
      // One name among numbers is reported as a bad time, with its line.
      return std::any_of(lines.begin(), lines.end(),
                         [](const Line& line) { return parse_decimal(line.fields[1], 0); })
                 ? FileLayout{.name = "TUM monoVO", .time = 1, .id = 0}
                 : FileLayout{.name = "TUM RGB-D", .image = 1};
    default:
      return {.name = "TUM monoVO", .time = 1, .id = 0, .exposure = 2};
  }
}

/// `text` as the number that it consists of, in a form that compares equal for 7 and 007. Nothing
/// if it is not one.
std::optional<std::string> id_of(std::string_view text) {
  if (text.empty() || !std::all_of(text.begin(), text.end(), is_digit)) return std::nullopt;
  text.remove_prefix(std::min(text.find_first_not_of('0'), text.size() - 1));
  return std::string(text);
}

/// What a line calls each of the images, as `layout` has it.
std::vector<std::string> keys_of_images(const FileLayout& layout,
                                        const std::vector<std::string>& names) {
  if (layout.image >= 0) return names;
  std::vector<std::string> stems;
  std::vector<std::string> places;
  for (const auto& name : names) {
    if (const auto id = id_of(std::filesystem::path(name).stem().string())) stems.push_back(*id);
    places.push_back(std::to_string(places.size()));
  }
  return layout.id >= 0 && stems.size() == names.size() ? stems : places;
}

std::map<std::string, const Line*> lines_by_key(const std::filesystem::path& file,
                                                const FileLayout& layout,
                                                const std::vector<Line>& lines) {
  std::map<std::string, const Line*> by_key;
  for (const auto& line : lines) {
    std::string key = std::to_string(by_key.size());
    if (layout.image >= 0) {
      key = std::filesystem::path(line.fields[1]).filename().string();
    } else if (layout.id >= 0) {
      const auto id = id_of(line.fields[0]);
      if (!id) fail(file, line, "'" + line.fields[0] + "' is not the number of an image");
      key = *id;
    }
    const auto [at, is_new] = by_key.emplace(std::move(key), &line);
    if (is_new) continue;
    fail(file, line, at->first + " is already on line " + std::to_string(at->second->number));
  }
  return by_key;
}

ImageTime parse(const std::filesystem::path& file, const FileLayout& layout, const Line& line) {
  const auto& time = line.fields[static_cast<std::size_t>(layout.time)];
  const auto time_ns =
      layout.is_date ? parse_date(time, line.fields[1]) : parse_decimal(time, layout.digits);
  if (!time_ns) {
    fail(file, line,
         "'" + time + "' is not " +
             (layout.is_date       ? "a date with a time of day"
              : layout.digits == 0 ? "a time in nanoseconds"
                                   : "a time in seconds"));
  }
  if (layout.exposure < 0) return {*time_ns};
  const auto& exposure = line.fields[static_cast<std::size_t>(layout.exposure)];
  const auto exposure_ns = parse_decimal(exposure, kNanosecondDigitsOfMs);
  if (!exposure_ns || *exposure_ns > std::numeric_limits<std::uint32_t>::max()) {
    fail(file, line, "'" + exposure + "' is not an exposure time in milliseconds, up to 4294");
  }
  return {*time_ns, static_cast<std::uint32_t>(*exposure_ns)};
}

}  // namespace

ImageTimes read_times_file(const std::filesystem::path& file,
                           const std::vector<std::string>& names) {
  const auto lines = read_lines(file);
  const auto layout = layout_of(file, lines);
  if (layout.image < 0 && layout.id < 0 && lines.size() != names.size()) {
    fail(file,
         std::to_string(lines.size()) + " times for " + std::to_string(names.size()) + " images");
  }
  const auto keys = keys_of_images(layout, names);
  const auto by_key = lines_by_key(file, layout, lines);
  if (by_key.size() > names.size()) {
    log_warn("{} has {} times for {} images; images are missing", file.string(), by_key.size(),
             names.size());
  }
  std::vector<ImageTime> times;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto at = by_key.find(keys[i]);
    if (at == by_key.end()) {
      const bool is_named = keys[i] == names[i];
      fail(file, "no line for image " + names[i] + (is_named ? "" : ", number " + keys[i]));
    }
    times.push_back(parse(file, layout, *at->second));
    if (i > 0 && times[i].capture_time_ns <= times[i - 1].capture_time_ns) {
      fail(file, *at->second,
           "the time of " + names[i] + " is not after that of " + names[i - 1] + " before it");
    }
  }
  return {layout.name, std::move(times)};
}

std::optional<std::int64_t> parse_decimal(std::string_view text, int digits) {
  const auto mantissa = text.substr(0, text.find_first_of("eE"));
  int exponent = 0;
  if (mantissa.size() < text.size()) {
    auto rest = text.substr(mantissa.size() + 1);
    if (rest.size() > 1 && rest[0] == '+' && is_digit(rest[1])) rest.remove_prefix(1);
    const auto number = parse_number<int>(rest);
    if (!number || *number < -99 || *number > 99) return std::nullopt;
    exponent = *number;
  }
  const auto whole = mantissa.substr(0, mantissa.find('.'));
  const auto fraction = mantissa.substr(std::min(whole.size() + 1, mantissa.size()));
  auto all = std::string(whole).append(fraction);
  if (all.empty() || !std::all_of(all.begin(), all.end(), is_digit)) return std::nullopt;

  // The integer part of the result: so many digits of the mantissa, zeros where it is shorter.
  const auto wanted = static_cast<std::ptrdiff_t>(whole.size()) + exponent + digits;
  all.resize(static_cast<std::size_t>(std::max<std::ptrdiff_t>(wanted, 0)), '0');
  return all.empty() ? 0 : parse_number<std::int64_t>(all);
}

}  // namespace orbbuf
