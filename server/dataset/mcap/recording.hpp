// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/drop_record.hpp"
#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/sample.hpp"
#include "server/calibration/camera_info.hpp"
#include "server/dataset/mcap/file.hpp"
#include "server/session/records.hpp"

namespace orbbuf::mcap {

/// A session, or a part of one, as an MCAP file (https://mcap.dev), which Foxglove and mcap's own
/// tools open:
///
///   /ROBOT/image              foxglove.CompressedImage, the frames byte for byte
///   /ROBOT/calibration        foxglove.CameraCalibration, one with each frame, if the robot sent a
///                             camera.txt that it can express
///   /ROBOT/{left,right}/...   the same of stereo frames; the right calibration needs the baseline
///   /ROBOT/drops              orbbuf.Drop, JSON: the frames that will not come
///   /ROBOT/quality            orbbuf.Quality, JSON: one with each frame of which it is known
///   /ROBOT/NAME               orbbuf.Imu, JSON: the samples of the stream NAME
///
/// The log time of each is the time of capture, so that a player shows what the camera saw when; a
/// time before 1970 becomes 0 there. The sequence of a message is the number of the frame or the
/// sample, modulo 2^32.
/// Blocking; reentrant.
class Recording {
 public:
  /// Makes the file, in place of one that is there.
  static Result<Recording> create(const std::filesystem::path& path, const SessionInfo& info);

  /// True: about a megabyte was written.
  Result<bool> add(const EncodedFrame& frame);
  /// A message for each frame of the range.
  Result<bool> add(const DropRecord& range);
  /// A message for each sample, if it is a stream of samples.
  Result<bool> add(const RecordedItems& items);
  Result<bool> add(wire::StreamId stream, std::uint64_t number, const Sample& sample);
  /// Why there is no calibration in it, though the session has one; empty: there is.
  const std::string& problem() const { return cameras_.problem; }

  /// Makes the file complete. clock_offset_ns: if it is not 0, a metadata record `orbbuf.clock`
  /// says that it is to be added to all times (`offset_ns`).
  std::optional<Error> finish(std::int64_t clock_offset_ns);

 private:
  Recording(File file, const SessionInfo& info);

  Result<bool> add(std::uint16_t channel, Sequence sequence, std::int64_t time_ns,
                   std::span<const std::uint8_t> data);
  std::string name_of(std::uint16_t channel) const;
  std::string frame_id(std::uint16_t channel) const;

  File file_;
  const std::string robot_id_;
  const std::vector<wire::StreamDeclaration> streams_;
  const CalibratedCameras cameras_;
};

}  // namespace orbbuf::mcap
