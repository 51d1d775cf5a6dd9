// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "server/dataset/mcap/recording.hpp"
#include "server/session/records.hpp"
#include "server/session/sequence_set.hpp"

namespace orbbuf::mcap {

/// The file of a part of a session's recording: `SESSION-0001.mcap`.
std::string part_name(const std::string& session_id, std::uint32_t number);

/// Makes a part of a session's recording of the records that the part has and their images, a
/// little at a time, also while the session goes on. The file appears by rename, when it is on the
/// device. Samples stand as they came. Late frames and drop records stand behind the live frames;
/// the whole JPEG of a frame that came reduced takes its place if it came before the part was made,
/// and is among the late frames of the next part else. A frame whose images are gone is passed
/// over, with one warning, and so are dropped frames beyond kMostDrops. Blocking; reentrant.
class PartMaker {
 public:
  static constexpr std::uint64_t kMostDrops = 100'000;

  /// Touches nothing. summary: of the session, as it is now.
  PartMaker(std::filesystem::path folder, const SessionSummary& summary, RecordedPart part);
  ~PartMaker();
  PartMaker(const PartMaker&) = delete;
  PartMaker& operator=(const PartMaker&) = delete;

  /// Goes on for about a megabyte. True: that was all. After an error nothing is left of it.
  Result<bool> go_on();

  /// With the bytes of its images, once all is done.
  const RecordedPart& part() const { return part_; }
  /// There was nothing to be recorded: there is no file.
  bool is_empty() const { return !recording_; }

 private:
  template <class Item>
  Result<bool> put(const Item& item);
  Result<bool> add(const RecordedFrame& frame);
  Result<bool> add_record(const RecordBody& body);
  std::optional<Error> finish();

  const std::filesystem::path folder_;
  const SessionInfo info_;
  const std::int64_t clock_offset_ns_;
  RecordedPart part_;
  const std::filesystem::path path_;
  const std::filesystem::path temporary_;
  RecordReader reader_;
  std::optional<Recording> recording_;
  SequenceSet live_;
  std::vector<RecordedFrame> late_;
  std::size_t next_late_ = 0;
  std::uint64_t missing_ = 0;  // frames
  std::uint64_t drops_left_ = kMostDrops;
  bool are_drops_cut_ = false;
};

/// Whether the session was recorded, and has frames, samples or drop records behind the last part.
/// False also if that cannot be read.
bool lacks_part(const std::filesystem::path& folder);

/// Brings the journal onto the device, and removes the images of the frames that the part has, but
/// a whole JPEG that came since. The part must be in the journal, as their only copy.
std::optional<Error> remove_images(const std::filesystem::path& folder, const RecordedPart& part);

/// The same for the session's last part, if that is the only copy: a kill may have come before.
std::optional<Error> remove_images(const std::filesystem::path& folder);

/// The frames whose images are in parts only. Reads the journal.
Result<SequenceSet> numbers_without_images(const std::filesystem::path& folder);

}  // namespace orbbuf::mcap
