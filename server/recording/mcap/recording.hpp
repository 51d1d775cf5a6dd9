// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/wire.hpp"
#include "server/calibration/camera_info.hpp"
#include "server/recording/late_list.hpp"
#include "server/recording/mcap/file.hpp"
#include "server/recording/sequence_set.hpp"
#include "server/recording/session_info.hpp"
#include "server/recording/session_record.hpp"

namespace orbbuf::mcap {

/// One session as an MCAP file (https://mcap.dev), which Foxglove and mcap's own tools open:
///
///   /ROBOT/image              foxglove.CompressedImage, the frames byte for byte
///   /ROBOT/calibration        foxglove.CameraCalibration, one with each frame, if the robot sent a
///                             camera.txt that it can express
///   /ROBOT/{left,right}/...   the same of stereo frames; the right calibration needs the baseline
///   /ROBOT/drops              orbbuf.Drop, JSON: the frames that will not come
///   /ROBOT/quality            orbbuf.Quality, JSON: one with each frame of which it is known
///
/// The log time of each is the time of capture, so that a player shows what the camera saw when; a
/// time before 1970 becomes 0 there. If the robot's clock was set meanwhile, a metadata record
/// `orbbuf.clock` says what is to be added to all times (`offset_ns`). A frame's messages have its
/// sequence, those of the drops count them (both modulo 2^32). File says what survives a kill.
class Recording final : public SessionRecord {
 public:
  /// Touches nothing: the file is made by the first write.
  Recording(std::filesystem::path path, const SessionInfo& info);

  /// How far the recording reaches. files: the position of the session's files, if it keeps them;
  /// they are written after this, so what is here and not there was never acknowledged, and goes.
  /// A power cut may have taken more from the files than a kill could: that much stays here, and
  /// when it comes again for the files it is not written a second time.
  Result<wire::Position> recover(const std::optional<wire::Position>& files);

  /// Takes what the recording lacks of the session's files, which are in `folder` and reach
  /// `files`: a power cut may have spared them only. Nothing, with a warning, if that is more than
  /// kMostMissed frames: then the recording began later. Requires recover().
  std::optional<Error> take_missed(const std::filesystem::path& folder,
                                   const wire::Position& files);
  static constexpr std::uint64_t kMostMissed = 1000;

  /// Those of these frames that the recording has already. Requires recover().
  Result<SequenceSet> frames_among(const LateList& late) const;
  /// A frame of any number, without looking whether it is there.
  std::optional<Error> write_late(const EncodedFrame& frame) { return append(frame); }

  std::optional<Error> write(const EncodedFrame& frame) override;
  std::optional<Error> write_drops(const wire::Dropped& dropped) override;
  std::optional<Error> finish(SessionClosing& closing) override;

 private:
  std::optional<Error> append(const EncodedFrame& frame);
  std::optional<Error> take_missed_drops(const std::filesystem::path& folder);
  void describe(std::uint16_t channel, Batch& batch) const;
  void add_image(const EncodedFrame& frame, std::uint16_t channel,
                 std::span<const std::uint8_t> jpeg, Batch& batch) const;
  void add_calibration(const EncodedFrame& frame, std::uint16_t channel, const CameraInfo& camera,
                       Batch& batch) const;

  std::string robot_id_;
  CalibratedCameras cameras_;
  wire::Position known_;  // since recover(): what is below is there, even if it comes again
  File file_;
};

}  // namespace orbbuf::mcap
