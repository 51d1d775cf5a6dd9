// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "common/error.hpp"
#include "common/wire.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf {

/// Which views of a session.
enum class Views : std::uint8_t {
  kAll,
  kAllButTimes,  ///< of a session that is open: times.txt and data.csv are being written
};

/// Makes the text files of a session anew from its journal; each appears by rename, session.txt as
/// the last:
///
///   times.txt       a line for each frame, sorted by number
///   checksums.sfv   `images/000123.jpg 8C4F21D3`: each image's CRC-32, as cksfv and rhash read it
///   drops.csv       the frames that are not there and will not come, kDropCsvHeader first; at most
///                   most_drop_lines()
///   quality.csv     `123,30,40123,0A1B2C3D`: a frame's quality, and what it was reduced from
///   imu0/data.csv   the samples of a stream, kEurocImuHeader first; a file for each stream
///   session.txt     `KEY VALUE`, what became of the session, for people
///
/// With kAll, images that no record explains move to orphans/, unless the journal is damaged.
/// Blocking; reentrant for different sessions. Memory: that of a SessionOutline and the drop
/// records.
std::optional<Error> make_views(const std::filesystem::path& folder, Views views);

/// Makes the data.csv of one stream of samples, likewise.
Result<SampleTotals> write_samples(const std::filesystem::path& folder,
                                   const wire::StreamDeclaration& stream);

}  // namespace orbbuf
