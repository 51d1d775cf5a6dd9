// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace orbbuf::evaluation {

/// A frame of a sequence that arrives at the server.
struct ListedArrival {
  std::string image;  ///< the file's name in the sequence's folder images/
  std::size_t number =
      0;  ///< of the frame in what is played: the sequence, or the sequence back and forth
  double capture_s = 0;  ///< from the begin of what is played
  double arrival_s = 0;  ///< when the last byte had passed the link, on the same clock
  int quality = 0;       ///< JPEG's, at which it was sent; 0: as the sequence has it
};

/// Which frames of a sequence arrive through one outage, and when. README.md has the format.
struct OutageList {
  std::string sequence;
  std::string sha256;  ///< of all its images, by name, one after the other
  std::string policy;
  std::string link;
  double lateness_s = 0;    ///< after which the stream was to be live again
  double live_again_s = 0;  ///< after which it was
  double begin_s = 0;       ///< of the outage
  double length_s = 0;
  std::vector<ListedArrival> arrivals;  ///< in the order of arrival

  double return_s() const { return begin_s + length_s; }
};

/// Throws std::runtime_error.
void write_list(const std::filesystem::path& file, const OutageList& list);
/// Throws std::runtime_error naming file and line.
OutageList read_list(const std::filesystem::path& file);

/// The images of a sequence's folder images/, by name. Throws std::runtime_error if there is none.
std::vector<std::filesystem::path> images_of(const std::filesystem::path& sequence);
/// What `cat images/* | sha256sum` says. Throws std::runtime_error.
std::string sha256_of(const std::vector<std::filesystem::path>& images);

}  // namespace orbbuf::evaluation
