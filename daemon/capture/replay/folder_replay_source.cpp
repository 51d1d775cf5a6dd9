// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/folder_replay_source.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <fstream>
#include <limits>
#include <set>
#include <sstream>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "common/error.hpp"
#include "daemon/capture/replay/replay_frame.hpp"
#ifdef ORBBUF_IMAGE_FILES
#include <opencv2/imgcodecs.hpp>
#endif

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMaxFileBytes = 256U
                                         << 20U;  // an image of 65535 pixels square is no input

std::string lower_extension(const fs::path& file) {
  auto extension = file.extension().string();
  for (auto& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return extension;
}

bool is_jpeg(const fs::path& file) {
  const auto extension = lower_extension(file);
  return extension == ".jpg" || extension == ".jpeg";
}

bool is_image(const fs::directory_entry& entry) {
  const auto extension = lower_extension(entry.path());
  if (entry.path().filename().string().starts_with('.')) return false;
  if (!is_jpeg(entry.path()) && extension != ".png" && extension != ".pgm") return false;
  // A link to nowhere stands for a frame that is missing, and is to be seen as one.
  std::error_code error;
  const auto type = entry.status(error).type();
  return type == fs::file_type::regular || type == fs::file_type::not_found;
}

/// What a name is ordered by. A run of digits counts as a number wherever it stands: frame2 comes
/// before frame10. Of a name that is a time in seconds the second run is a fraction.
std::string order_of(std::string_view name) {
  constexpr std::string_view kDigits = "0123456789";
  const auto first_end = name.find_first_not_of(kDigits);
  std::string order;
  for (std::size_t i = 0; i < name.size();) {
    auto run = name.substr(i, name.find_first_not_of(kDigits, i) - i);
    if (run.empty()) {
      order += name[i++];
      continue;
    }
    const bool is_fraction = i > 1 && first_end == i - 1 && name[i - 1] == '.';
    i += run.size();
    if (!is_fraction) {
      run.remove_prefix(std::min(run.find_first_not_of('0'), run.size() - 1));
      order += fmt::format("0{:03}", run.size());  // a digit, which letters compare with as before
    }
    order += run;
  }
  return order;
}

/// Sorted by name; empty if there is no such folder.
std::vector<std::string> image_names(const fs::path& folder) {
  std::set<std::pair<std::string, std::string>> ordered;
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (!is_image(*entry)) continue;
    auto name = entry->path().filename().string();
    auto order = order_of(name);
    ordered.emplace(std::move(order), std::move(name));
  }
  if (error && error != std::errc::no_such_file_or_directory &&
      error != std::errc::not_a_directory) {
    throw std::runtime_error("cannot replay images from " + folder.string() + ": " +
                             error.message());
  }
  std::vector<std::string> names;
  names.reserve(ordered.size());
  for (const auto& [order, name] : ordered) names.push_back(name);
  return names;
}

/// Where the images of a data set are, from its folder: a session, TUM monoVO, TUM RGB-D, KITTI
/// odometry, KITTI raw and EuRoC.
constexpr std::array<std::string_view, 7> kImageFolders = {
    "images", "rgb", "image_0", "image_00/data", "mav0/cam0/data", "cam0/data", "data"};

/// Of a data set's images. What is beside another folder may be of something else.
fs::path find_times_file(const fs::path& folder) {
  const auto name = folder.filename();
  std::vector<fs::path> files = {folder / "times.txt", folder.parent_path() / "times.txt"};
  if (name == "rgb") files.push_back(folder.parent_path() / "rgb.txt");
  if (name == "data") files.push_back(folder.parent_path() / "data.csv");
  if (name == "data") files.push_back(folder.parent_path() / "timestamps.txt");
  for (const auto& file : files) {
    std::error_code error;
    if (fs::exists(file, error)) return file;
  }
  return {};
}

Result<std::vector<std::uint8_t>> read_file(const fs::path& file) {
  const auto attempt = "cannot read " + file.string();
  std::error_code error;
  const auto size = fs::file_size(file, error);
  if (error) return Error{attempt + ": " + error.message()};
  if (size == 0) return Error{attempt + ": the file is empty"};
  if (size > kMaxFileBytes) return Error{attempt + ": the file is larger than 256 MiB"};
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  std::ifstream in(file, std::ios::binary);
  if (!in) return system_error(attempt, errno);
  in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (!in) return Error{attempt + ": the file was truncated"};
  return bytes;
}

RawFrame jpeg_frame(std::vector<std::uint8_t> bytes) {
  auto owner = std::make_shared<const std::vector<std::uint8_t>>(std::move(bytes));
  RawFrame frame;
  frame.format = PixelFormat::kJpeg;
  frame.data = *owner;
  frame.lease = std::move(owner);
  return frame;
}

#ifdef ORBBUF_IMAGE_FILES
/// The value of white in `image`, which OpenCV decoded from `file`. Of a PGM the head says it, in
/// its third number; OpenCV heeds that in a text of at most 8 bits only.
double white_of(const cv::Mat& image, const std::vector<std::uint8_t>& file) {
  const bool is_pgm = file[0] == 'P' && (file[1] == '5' || image.depth() == CV_16U);
  if (!is_pgm) return image.depth() == CV_16U ? 65535 : 255;
  std::istringstream head(std::string(file.begin() + 2, file.end()));
  double number = 0;
  for (int i = 0; i < 3; ++i) {
    while ((head >> std::ws).peek() == '#') head.ignore(std::numeric_limits<int>::max(), '\n');
    head >> number;
  }
  return number;
}
#endif

RawFrame read_image(const fs::path& file, [[maybe_unused]] bool is_color) {
  auto bytes = read_file(file);
  if (!bytes) return frame_with_defect(bytes.error().text);
  if (is_jpeg(file)) return jpeg_frame(std::move(bytes).value());
  const auto attempt = "cannot read " + file.string();
#ifdef ORBBUF_IMAGE_FILES
  try {
    const int flags = is_color ? cv::IMREAD_COLOR : cv::IMREAD_GRAYSCALE;
    auto image =
        cv::imdecode(bytes.value(), flags | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
    if (!image.empty()) {
      image.convertTo(image, CV_8U, 255 / white_of(image, bytes.value()));
      return replay_frame(std::move(image), 0);
    }
    return frame_with_defect(attempt + ": not an image, or a truncated one");
  } catch (const cv::Exception& error) {
    return frame_with_defect(attempt + ": " + error.err);
  }
#else
  return frame_with_defect(attempt + ": orbbufd was built without OpenCV's imgcodecs");
#endif
}

/// settings.path or path_right. Throws if there are no images.
ImageFolder find_images(const fs::path& path) {
  if (path.empty()) throw std::runtime_error("cannot replay images: source.path is not set");
  fs::path folder = fs::absolute(path).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();  // the path ended in a slash
  const auto attempt = "cannot replay images from " + folder.string();
  std::error_code error;
  const auto status = fs::status(folder, error);
  if (!fs::exists(status)) throw std::runtime_error(attempt + ": " + error.message());
  if (!fs::is_directory(status)) throw std::runtime_error(attempt + ": not a folder");
  if (auto names = image_names(folder); !names.empty()) return {folder, std::move(names)};
  for (const auto below : kImageFolders) {
    if (auto names = image_names(folder / below); !names.empty()) {
      return {folder / below, std::move(names)};
    }
  }
  throw std::runtime_error(fmt::format("{}: no png, jpg, jpeg or pgm file in it or in its {}",
                                       attempt, fmt::join(kImageFolders, ", ")));
}

ImageFolder find_right_images(const fs::path& path, const ImageFolder& left) {
  auto right = find_images(path);
  const auto attempt = fmt::format("cannot replay images from {} as the right images of {}",
                                   right.path.string(), left.path.string());
  if (right.path == left.path) throw std::runtime_error(attempt + ": both are the same folder");
  if (right.names.size() == left.names.size()) return right;
  throw std::runtime_error(fmt::format("{}: {} right images, {} left images", attempt,
                                       right.names.size(), left.names.size()));
}

}  // namespace

FolderReplaySource::FolderReplaySource(const SourceSettings& settings)
    : fps_(settings.fps), is_color_(settings.color), left_(find_images(settings.path)) {
  if (!settings.path_right.empty()) right_ = find_right_images(settings.path_right, left_);
  times_file_ = find_times_file(left_.path);
  if (times_file_.empty()) return;
  auto read = read_times_file(times_file_, left_.names);
  layout_ = read.layout;
  times_ = std::move(read.times);
}

std::optional<RawFrame> FolderReplaySource::next(std::stop_token stop) {
  if (next_ == left_.names.size() || stop.stop_requested()) return std::nullopt;
  const auto index = next_++;
  auto frame = read_image(left_.path / left_.names[index], is_color_);
  if (right_) {
    frame.right = std::make_shared<const RawFrame>(
        read_image(right_->path / right_->names[index], is_color_));
  }
  if (times_.empty()) {
    frame.capture_time_ns = nominal_time_ns(static_cast<std::int64_t>(index), fps_);
  } else {
    frame.capture_time_ns = times_[index].capture_time_ns;
    frame.exposure_ns = times_[index].exposure_ns;
  }
  return frame;
}

std::string FolderReplaySource::description() const {
  const auto times = times_.empty()
                         ? fmt::format("{:.4g} fps", fps_)
                         : fmt::format("times from {} ({})", times_file_.string(), layout_);
  if (!right_) {
    return fmt::format("folder {}: {} images, {}", left_.path.string(), left_.names.size(), times);
  }
  return fmt::format("folders {} and {}: {} pairs of images, {}", left_.path.string(),
                     right_->path.string(), left_.names.size(), times);
}

}  // namespace orbbuf
