// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/drop_record.hpp"
#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/sample.hpp"
#include "server/session/records.hpp"
#include "server/session/sequence_set.hpp"

/// Reading what SessionStore has written, also while it writes. All of it is blocking and
/// reentrant, and changes nothing.
namespace orbbuf {

/// A session as its journal has it. No image is opened.
struct RecordedSession {
  std::filesystem::path folder;
  SessionSummary summary;
  /// Live and late ones, by number, each once: of one that was replaced as it is now.
  std::vector<RecordedFrame> frames;
  /// What is named and not there, by number, none twice: by the robot's drop records and accounts;
  /// after a final account also what nothing names and the robot does not hold (kUnknown, kLost).
  std::vector<DropRecord> drops;
  /// Damage of the journal, one line each.
  std::vector<std::string> problems;
};

/// The whole session. An error if `folder` has no journal, or it cannot be read. Memory: 64 bytes a
/// frame.
Result<RecordedSession> read_session(const std::filesystem::path& folder);

/// A session without its live frames, which are most of it. Memory: a bit for each frame that is
/// there, 72 bytes for each late one.
struct SessionOutline {
  SessionSummary summary;
  SequenceSet there;                ///< numbers of the frames, live and late
  std::vector<RecordedFrame> late;  ///< by number, those that replace a live one among them
  std::vector<DropRecord> named;    ///< as they came
  std::vector<std::string> problems;
  journal::Place end;  ///< behind the last record, as it was then
};
Result<SessionOutline> read_outline(const std::filesystem::path& folder);

/// Hands on all frames of the outline by number, as RecordedSession has them, and returns its
/// drops. Memory: these.
Result<std::vector<DropRecord>> for_each_frame(
    const std::filesystem::path& folder, const SessionOutline& outline,
    const std::function<void(const RecordedFrame&)>& take);

/// The items of all streams, in the order in which they came.
std::optional<Error> read_items(const std::filesystem::path& folder,
                                const std::function<void(const RecordedItems&)>& take);

/// What came of one stream of samples. The server has `samples` of the numbers below `next`; of the
/// others, `on_robot` are on the robot's disk, and the rest is lost.
struct SampleTotals {
  std::uint64_t samples = 0;
  std::uint64_t next = 0;
  std::uint64_t backward = 0;       ///< whose time is not after that of the one before
  std::uint64_t behind_frames = 0;  ///< not newer than a frame that came live before them
  bool is_final = false;            ///< else more may come, also of those that count as lost
  std::uint64_t on_robot = 0;       ///< with is_final

  std::uint64_t lost() const { return next - std::min(next, samples + on_robot); }
};
/// Hands on the samples of a stream in the order of their numbers, also those that came late.
/// Memory: 24 bytes for each record of these, and one record.
Result<SampleTotals> for_each_sample(const std::filesystem::path& folder,
                                     const wire::StreamDeclaration& stream,
                                     const std::function<void(const Sample&)>& take);

/// Where a journal ends: the records from the newest checkpoint on, added up.
struct Tail {
  SessionSummary summary;
  journal::Place end;
  journal::Place kept;
  bool is_clean = false;
  std::uint64_t damaged_bytes = 0;  ///< passed over
};
/// As if the journal ended at `until`. `first`: what is known before the first record. Nothing: it
/// then has no record.
Result<std::optional<Tail>> read_tail(const std::filesystem::path& folder,
                                      const SessionSummary& first,
                                      const journal::Place& until = kNowhere);

/// Where the session stands: reads the newest segment of the journal only. Nothing: there is none,
/// or it cannot be read.
std::optional<SessionSummary> read_summary(const std::filesystem::path& folder);

/// The images of a frame, as one frame. An error if one of them cannot be read. They are not
/// compared with their checksums: see is_whole(). The whole images may be in place of reduced ones;
/// of a stereo frame one of them may still be in the file in which it came.
Result<EncodedFrame> read_images(const std::filesystem::path& folder, const RecordedFrame& frame);

/// Whether one of them is not there, which is certain: another error is for now.
bool are_images_gone(const std::filesystem::path& folder, const RecordedFrame& frame);

/// Whether the images are what the record says, or, of a reduced frame, the whole JPEG: a power cut
/// may have lost the record of that.
bool is_whole(const RecordedFrame& recorded, const EncodedFrame& images);

/// The live frames of a session, in order, while it grows.
class FrameFollower {
 public:
  explicit FrameFollower(std::filesystem::path folder);

  /// The first live frame from `first` on; null if there is none yet. A frame whose images cannot
  /// be read is passed over with a warning. Cost: the frame's images and 64 KiB of the journal at
  /// most; in the first call, and in one that goes back, one search for the segment.
  Result<FramePtr> next(Sequence first);
  /// The items of other streams that the journal has before the frame of the last next(), behind
  /// the frame before; without one, those behind the last frame.
  std::vector<RecordedItems> take_items() { return std::exchange(items_, {}); }

 private:
  std::optional<Error> seek(Sequence first);

  const std::filesystem::path folder_;
  std::optional<RecordReader> reader_;
  std::optional<Sequence> given_;  // the last frame that was handed out or passed over
  std::vector<RecordedItems> items_;
};

}  // namespace orbbuf
