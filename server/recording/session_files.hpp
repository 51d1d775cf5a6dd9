// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/wire.hpp"
#include "server/recording/line_file.hpp"
#include "server/recording/segment_info.hpp"
#include "server/recording/session_record.hpp"

namespace orbbuf {

/// One session as a folder that DSO's dso_dataset opens as it is:
///
///   images/000123.jpg   the frames, byte for byte, named by sequence
///   images_right/000123.jpg   of stereo frames the right image; `images` has the left one
///   times.txt           `123 1.633012000 0.000000`: sequence, seconds, exposure in ms (0: unknown)
///   camera.txt          the robot's calibration, if it sent one
///   drops.csv           the frames that will not come, kDropCsvHeader first
///   end.csv             whether the robot has ended the session, and its counts (SessionClosing)
///   late/, late.csv, spool.csv   frames that came late (LateFiles); merge_late() puts them into
///   the
///                       lists above, sorted by number
///   segment.csv         where the folder's part of the session begins (SegmentInfo), if other
///                       servers have what was before
///   orphans/            what recover() found and could not explain; no program reads it
///   checksums.sfv       `images/000123.jpg 8C4F21D3`: each image's CRC-32, as cksfv and rhash
///                       read it
///   quality.csv         `123,30,40123,0A1B2C3D`: a frame's quality, and what it was reduced from
///
/// The line in times.txt is what makes a frame accepted: whatever is found without one was in the
/// middle of being written. Its quality and checksums are written before, so that each accepted
/// frame has them; those of a frame that was not accepted after all are ignored, and of two for one
/// frame or image the last counts. Each file appears by rename and each line by one append, without
/// fsync: an accepted frame survives the death of this process; GroupCommit is for that of the
/// machine. Blocking; reentrant. Called by one thread at a time; recover() is the first call.
class SessionFiles final : public SessionRecord {
 public:
  /// Touches nothing: the folder is made by the first write.
  SessionFiles(std::filesystem::path folder, std::string calibration, SegmentInfo segment = {});

  /// How far the record in the folder reaches; late frames do not count, merged or not. A torn last
  /// line is cut off. What a kill or a power cut left behind goes to the folder `orphans`: frames
  /// at the end that are not whole (FalseTail), images of either side at or past the position but
  /// those of late frames, a temporary file. No folder is an empty record, which stands
  /// where the segment begins. Reads the lists.
  Result<wire::Position> recover();

  std::optional<Error> write(const EncodedFrame& frame) override;
  std::optional<Error> write_drops(const wire::Dropped& dropped) override;
  /// In end.csv, which says that the session is open.
  void note(const SessionClosing& reported) override;
  /// Of a session without any frame or drop record nothing is kept.
  std::optional<Error> finish(SessionClosing& closing) override;

 private:
  Result<bool> cut_false_tail();
  std::optional<Error> prepare();
  std::optional<Error> recover_end();
  std::optional<Error> write_end(const SessionClosing& closing) const;
  std::optional<Error> write_right(const EncodedFrame& frame);
  std::optional<Error> append_lines(const EncodedFrame& frame);

  std::filesystem::path folder_;
  std::filesystem::path images_;
  std::filesystem::path images_right_;
  std::filesystem::path temporary_;  // not in images_, of which dso_dataset opens every file
  std::string calibration_;
  const SegmentInfo segment_;
  LineFile times_;
  LineFile drops_;
  LineFile checksums_;
  LineFile qualities_;
  SessionClosing reported_;  // as noted, also before recover()
  bool is_prepared_ = false;
};

}  // namespace orbbuf
