// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/journal/journal.hpp"
#include "common/log.hpp"
#include "common/unique_fd.hpp"
#include "server/session/durability.hpp"
#include "server/session/records.hpp"
#include "server/session/recovery.hpp"
#include "server/session/sequence_set.hpp"

namespace orbbuf {

/// One session on disk, as a folder that DSO's dso_dataset opens as it is:
///
///   journal.000000 ...   what has happened, in the order in which it did (records.hpp)
///   images/000123.jpg    the frames, byte for byte, named by number
///   images_right/000123.jpg   of stereo frames the right image; `images` has the left one
///   camera.txt           the robot's calibration, if it sent one
///   times.txt            `123 1.633012000 0.000000`: number, seconds, exposure in ms (0: unknown)
///   imu0/data.csv        the samples of a stream, kEurocImuHeader first
///   checksums.sfv, drops.csv, quality.csv, session.txt   see make_views()
///   orphans/             what was found and could not be explained; no program reads it
///
/// The record in the journal is what makes a frame accepted. Its images are renamed into place
/// before, and its line in times.txt follows, as do those of samples their record. All text files
/// are views: they can be made again from the journal, and nothing reads them back. An accepted
/// frame survives the death of this process; GroupCommit is for that of the machine, and set_kept()
/// tells what it has done. On a file system where that may not reach the device
/// (weak_file_system()) each call does so itself, with kAck.
///
/// Late frames stand in the journal as they come. They are in times.txt from close() on.
///
/// Blocking; reentrant. Called by one thread at a time. There is one object for a folder.
class SessionStore {
 public:
  /// The session as it was left: see recover_session(). Touches nothing if there is no folder: the
  /// first write makes it. `info`: of a new session. An error if the folder cannot be read.
  static Result<std::unique_ptr<SessionStore>> open(std::filesystem::path folder, SessionInfo info,
                                                    Durability durability);

  const std::filesystem::path& folder() const { return folder_; }
  const SessionSummary& summary() const { return summary_; }
  /// Nothing was ever written: there may be no folder.
  bool is_new() const { return is_new_; }
  /// It has been said what the samples of the stream are.
  bool has_stream(wire::StreamId stream) const;
  const wire::Position& position() const { return summary_.position; }

  /// Behind all that was written.
  journal::Place written() const { return journal_.end(); }
  /// All before `place`, what written() was, is on the device.
  void set_kept(const journal::Place& place);

  /// With the next write, `calibration` replaces the one that is there; empty: it stays.
  void calibrate(std::string calibration);
  /// A frame of the live stream. A repeat is ignored. On error nothing of it remains; but if the
  /// device has failed, all stays, and nothing more is accepted.
  std::optional<Error> write(const EncodedFrame& frame, std::int64_t arrived_ns);
  std::optional<Error> write_items(const RecordedItems& items);

  enum class Late : std::uint8_t {
    kNew,
    kReplaced,  ///< it was there reduced, from this very frame, and is whole now
    kRepeat,    ///< it was there with the same bytes
    kConflict,  ///< it was there with others: these are in orphans/ now
  };
  /// A frame that the live stream passed over or sent reduced. On error as with write(); the whole
  /// JPEG may then be in place of the reduced one all the same. The first call reads the whole
  /// journal.
  Result<Late> write_late(const EncodedFrame& frame, std::int64_t arrived_ns);
  /// Samples that the live stream did not bring. Those that are there already are left out, and so
  /// are items of a stream that the session has not, or that are none.
  std::optional<Error> write_late(const wire::Items& items);

  /// Of a session without a folder it is kept once there is one.
  std::optional<Error> note(const RecordedReport& report);
  std::optional<Error> note_part(const RecordedPart& part) { return append_to_folder(part); }
  /// What the robot knows of the session. What only counts on is recorded every kAccountInterval.
  std::optional<Error> take_account(const wire::Account& account);
  static constexpr std::chrono::seconds kAccountInterval{5};

  /// The live stream is over, or interrupted. Of a session without a folder nothing is kept. Views
  /// that cannot be made, as close() then does, are no error.
  std::optional<Error> finish(bool has_ended);
  /// Nothing is written for now. Makes the views, if something was since they were, and the robot
  /// does not hold frames of the session that will change them again.
  std::optional<Error> close();

 private:
  /// What the frames are, for late ones.
  struct Numbers {
    SequenceSet there;
    std::map<wire::StreamId, SequenceSet> items;
    std::vector<RecordedFrame> reduced;  // of the live stream, by number

    void add(const RecordedFrame& frame);
    void add(const RecordedItems& added);
    std::vector<RecordedFrame>::iterator find(Sequence sequence);
  };

  SessionStore(std::filesystem::path folder, RecoveredSession recovered, bool is_synced);

  std::optional<Error> prepare();
  std::optional<Error> begin_anew();
  std::optional<Error> append(const RecordBody& body);
  std::optional<Error> append_to_folder(const RecordBody& body);
  std::optional<Error> accept(const EncodedFrame& frame, const RecordedFrame& record);
  std::optional<Error> replace(const EncodedFrame& frame, const RecordedFrame& record);
  std::optional<Error> write_images(const EncodedFrame& frame, bool is_synced);
  void remove_images(Sequence sequence) const;
  void append_line(const RecordedFrame& frame, const journal::Place& place);
  void append_samples(const RecordedItems& items);
  void mend_from(const journal::Place& place);
  std::optional<Error> load_numbers();
  bool has_images(const EncodedFrame& frame) const;
  bool is_repeat(const EncodedFrame& frame) const;
  std::optional<Error> set_conflict_aside(const EncodedFrame& frame);

  const std::filesystem::path folder_;
  const bool is_synced_;  // each call
  SessionSummary summary_;
  std::string calibration_;  // to be recorded; empty: none
  journal::Writer journal_;
  journal::Place kept_;
  bool is_new_;                       // there is no record
  bool is_clean_;                     // nothing came since the last RecordedEnd; views are made
  bool has_new_late_ = false;         // that no views show
  std::optional<Error> sync_failed_;  // then nothing more is accepted
  bool is_prepared_ = false;
  bool has_right_folder_ = false;
  bool is_size_compared_ = false;  // of the first frame, with the calibration's
  std::optional<TimesFile> times_;
  std::map<wire::StreamId, UniqueFd> samples_;  // data.csv
  journal::Place times_from_;                   // lines of records from here on may be missing
  std::optional<Numbers> numbers_;
  std::optional<std::chrono::steady_clock::time_point> account_at_;
  LogLimit conflicts_{std::chrono::seconds{10}};
  LogLimit lines_{std::chrono::seconds{10}};
};

}  // namespace orbbuf
