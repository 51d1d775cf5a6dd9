// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bitset>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/crc32.hpp"
#include "common/drop_record.hpp"
#include "common/error.hpp"
#include "common/frame.hpp"

/// The messages of the link, as bytes: docs/protocol.md is the specification, this its only
/// implementation. Pure functions without sockets or state, so reentrant. Nothing here allocates
/// from a length that the peer sent before that length has been checked.
namespace orbbuf::wire {

inline constexpr std::uint32_t kMagic = 0x4F524242;  ///< "ORBB"
inline constexpr std::uint8_t kProtocolVersion = 6;  ///< the newest
inline constexpr std::uint8_t kOldestProtocolVersion = 6;
inline constexpr std::uint8_t kHeaderFormat = 1;
inline constexpr std::uint8_t kJpegEncoding = 1;
inline constexpr std::size_t kHeaderBytes = 20;
inline constexpr std::size_t kFrameMetaBytes = 40;
inline constexpr std::uint32_t kMaxControlBytes = 64 * 1024;  ///< body of anything but these:
inline constexpr std::uint32_t kMaxItemsBytes = 2U << 20;     ///< items; frames: see parse_header()
inline constexpr std::size_t kMaxIdBytes = 64;
inline constexpr std::size_t kMaxTextBytes = 1024;  ///< software name, error text
inline constexpr std::size_t kMaxCalibrationBytes = 16UL * 1024;
inline constexpr std::size_t kMaxDropsPerMessage = 1024;
inline constexpr std::size_t kMostStreams = 32;
inline constexpr std::size_t kMaxNameBytes = 128;  ///< of a stream, and of its codec

enum class Type : std::uint8_t {
  kHello = 1,    ///< robot -> server, first
  kWelcome = 2,  ///< server -> robot, answer to hello
  kFrame = 3,    ///< robot -> server: an item of stream kFrames
  kAck = 4,      ///< server -> robot
  kItems = 5,    ///< robot -> server: items of any other stream
  kStats = 6,    ///< robot -> server
  kBye = 7,      ///< robot -> server: nothing more will come; server -> robot: see Bye
  kError = 8,    ///< either way; the sender closes the connection after it
};

/// A robot's data cross the link as numbered streams. The items of each are numbered, and are taken
/// in that order, each once: what the server has of all of them is a Position.
using StreamId = std::uint16_t;
inline constexpr StreamId kFrames = 0;    ///< numbers are those of the frames, some are left out
inline constexpr StreamId kDrops = 1;     ///< DropRecord
inline constexpr StreamId kLate = 2;      ///< LateFrame, in parts; from 0 on in each connection
inline constexpr StreamId kAccounts = 3;  ///< Account; from 0 on in each connection
inline constexpr StreamId kFirstOther = 4;

/// A stream as the robot declares it.
struct StreamDeclaration {
  StreamId id = 0;
  std::string name;   ///< for people and views; not empty, unique within the session
  std::string codec;  ///< what the payload of its items is

  friend bool operator==(const StreamDeclaration&, const StreamDeclaration&) = default;
};

/// The name used in docs, logs and errors: `hello`, `welcome`, ...
std::string_view to_string(Type type);

/// What every message starts with, checked: magic, layout, own checksum, known type, body length.
struct Header {
  Type type{};
  std::uint32_t body_bytes = 0;
  std::uint32_t body_crc = 0;
};

struct Hello {
  std::uint8_t min_version = kOldestProtocolVersion;
  std::uint8_t max_version = kProtocolVersion;
  std::string robot_id;     ///< is_valid_id()
  std::string session_id;   ///< is_valid_id()
  std::string software;     ///< for the log: `orbbufd 0.1.0`
  std::string calibration;  ///< camera.txt in DSO's form, or empty
  std::vector<StreamDeclaration>
      streams;  ///< from kFirstOther on, ascending; the others are always there

  friend bool operator==(const Hello&, const Hello&) = default;
};

/// How far the server's record of a session reaches: of each stream the number of the next item.
/// Every item below that was ever written to the server is safely with its sinks.
class Position {
 public:
  Position() = default;
  Position(Sequence frames, std::uint64_t drops) : next_{frames, drops} {}

  std::uint64_t& operator[](StreamId id) { return next_.at(id); }
  std::uint64_t operator[](StreamId id) const { return next_.at(id); }
  friend bool operator==(const Position&, const Position&) = default;

 private:
  std::array<std::uint64_t, kMostStreams> next_{};
};

inline constexpr std::chrono::milliseconds kHeartbeat{250};

/// A bit of a welcome.
inline constexpr std::uint8_t kHasHeartbeat = 1;
/// Bits of an account.
inline constexpr std::uint8_t kIsFinal = 1;
inline constexpr std::uint8_t kHasEnded = 2;

struct Welcome {
  std::uint8_t version = kProtocolVersion;
  Position position;
  /// The largest frame (EncodedFrame::jpeg) that the server takes; 0: it does not say.
  std::uint32_t max_frame_bytes = 0;
  std::bitset<kMostStreams> takes;  ///< the streams that the server takes: kFrames, kDrops, ...
  /// The server repeats its last ack at least every kHeartbeat, whatever its sinks do: one that
  /// does not stands still.
  bool has_heartbeat = false;

  friend bool operator==(const Welcome&, const Welcome&) = default;
};

/// `position` may be forgotten by the robot: it is on the server's device, if that is asked for.
/// What the server has received it may only keep in memory; the link has done its work.
struct Ack {
  Position position;
  /// Every frame below it is with the server's sinks; not below the position.
  Sequence received = 0;
  std::string pause{};  ///< why the server takes nothing now, such as a full disk; empty: it does

  friend bool operator==(const Ack&, const Ack&) = default;
};

/// Items of one stream.
struct Items {
  StreamId stream = 0;  ///< not kFrames
  std::uint64_t first = 0;
  std::vector<std::uint8_t> payload;

  friend bool operator==(const Items&, const Items&) = default;
};

/// What became of the robot's frames. At every instant
/// captured = skipped + failed + dropped + acknowledged + waiting + in_flight.
struct Stats {
  std::uint64_t captured = 0;
  std::uint64_t skipped = 0;       ///< DropReason::kBusy
  std::uint64_t failed = 0;        ///< DropReason::kFailed
  std::uint64_t dropped = 0;       ///< DropReason::kPolicy and those at the end or refused
  std::uint64_t acknowledged = 0;  ///< the server's sinks have them
  std::uint64_t waiting = 0;       ///< in the buffer, or on their way into it
  std::uint64_t in_flight = 0;     ///< handed to the network, not yet acknowledged

  friend bool operator==(const Stats&, const Stats&) = default;
};

/// What a stats message says: the counts, and how buffer and link do at that moment.
struct Report {
  Stats stats;
  std::uint32_t capacity = 0;       ///< of the buffer, in frames
  std::uint64_t waiting_bytes = 0;  ///< JPEGs in the buffer
  std::uint64_t link_rate = 0;      ///< bytes a second that the peer's kernel took, lately
  std::uint32_t round_trip_us = 0;  ///< TCP's smoothed one; 0: unknown
  /// By how much the robot's clock was set since the session began: to be added to the capture
  /// times of the session, which keep the clock that it began with.
  std::int64_t clock_offset_ns = 0;
  /// Frames that were to be sent reduced and were sent as they are: their JPEG could not be read.
  std::uint64_t irreducible = 0;
  Position captured_items{};  ///< of the streams from kFirstOther on: behind the newest

  friend bool operator==(const Report&, const Report&) = default;
};

/// From the robot: the session is over, and its record ends before `position`. From the server: the
/// record reaches `position`, all of it or as much as there is when the server goes down.
struct Bye {
  Position position;

  friend bool operator==(const Bye&, const Bye&) = default;
};

/// The payload of kLate: a part of a late record (encode_late_record()). All parts of one carry the
/// number of the late frame; they follow each other from offset 0 on, and other messages may come
/// between them.
struct LatePart {
  std::uint32_t offset = 0;             ///< of `bytes` in the record
  std::uint32_t record_bytes = 0;       ///< the whole record's
  std::span<const std::uint8_t> bytes;  ///< at least one; within the record
};

/// A frame that the live stream of its session did not deliver, or delivered reduced: it is whole.
/// Or items of a stream from kFirstOther on, by their numbers in that session.
struct LateFrame {
  std::string session_id;  ///< of the present session or an earlier one of the robot
  EncodedFrame frame;
  std::optional<Items> items{};  ///< then there is no frame
};

/// What the robot knows of a stream from kFirstOther on.
struct StreamAccount {
  StreamDeclaration stream;
  std::uint64_t captured = 0;  ///< items below it were captured, at least
  std::uint64_t held = 0;      ///< items on its disk, to be sent late; some may be sent already

  friend bool operator==(const StreamAccount&, const StreamAccount&) = default;
};

/// The payload of kAccounts: what the robot knows of one of its sessions. Each replaces the one
/// before, but adds to the frames that were given up.
struct Account {
  std::string session_id;
  /// No process of the session lives: nothing but late frames will come of it. Then each number
  /// below `captured` that the server has neither as a frame nor in a drop record is lost, if it
  /// will not come late; and DropReason::kLost below `confirmed`, DropReason::kUnknown from there.
  bool is_final = false;
  bool has_ended = false;  ///< in an orderly way
  Sequence captured = 0;   ///< frames below it were captured, at least; see known_end()
  std::int64_t last_capture_time_ns = 0;
  Sequence confirmed = 0;            ///< the server has acknowledged all below it
  std::uint64_t held = 0;            ///< frames that the robot keeps on its disk to send late
  Sequence first_held = 0;           ///< the lowest number of them
  std::vector<DropRecord> given_up;  ///< at most kMaxDropsPerMessage; some may be known already
  std::vector<StreamAccount> streams{};

  /// The robot has something of the session to send late.
  bool is_held() const;
  friend bool operator==(const Account&, const Account&) = default;
};

/// What encode_account() writes as `captured`: no frame that the account speaks of is beyond it.
Sequence known_end(const Account& account);

enum class ErrorCode : std::uint16_t {
  kMalformed = 1,   ///< bytes that are not this protocol
  kVersion = 2,     ///< no protocol version in common
  kTooLarge = 3,    ///< a length over the receiver's limit
  kUnexpected = 4,  ///< a well-formed message at the wrong moment
  kTimeout = 5,     ///< nothing came for too long
  kReplaced = 6,    ///< the same robot connected again
  kRefused = 7,     ///< a limit of the server, or not now
  kSentAway = 8,    ///< the server cannot keep frames: connect again, to another if there is one
};

struct ErrorMessage {
  ErrorCode code{};
  std::string text;  ///< one line for a person

  friend bool operator==(const ErrorMessage&, const ErrorMessage&) = default;
};

/// 1 .. kMaxIdBytes of [A-Za-z0-9._-], not starting with '.' or '-': safe as a file name.
bool is_valid_id(std::string_view id);

using orbbuf::crc32;

/// Whole messages, header and body. Texts over their limit are cut; ids must be valid.
std::vector<std::uint8_t> encode(const Hello& hello);
std::vector<std::uint8_t> encode(const Welcome& welcome);
std::vector<std::uint8_t> encode(const Ack& ack);
std::vector<std::uint8_t> encode(const Items& items);
std::vector<std::uint8_t> encode(const Report& report);
std::vector<std::uint8_t> encode(const Bye& bye);
std::vector<std::uint8_t> encode(const ErrorMessage& error);

/// Payloads of items.
std::vector<std::uint8_t> encode_drops(std::span<const DropRecord> records);
std::vector<std::uint8_t> encode_late_part(const LatePart& part);
std::vector<std::uint8_t> encode_account(const Account& account);

/// All of a frame message but the JPEG bytes, which follow it on the wire. Does not read the JPEG:
/// the body's checksum is combined from frame.jpeg_crc in constant time.
std::array<std::uint8_t, kHeaderBytes + kFrameMetaBytes> encode_frame_head(
    const EncodedFrame& frame);

/// What the parts of a late frame make up: the session's id as a text, a Type, the CRC-32 of what
/// follows, and the body of a message of that type: frame or items.
std::vector<std::uint8_t> encode_late_record(std::string_view session_id,
                                             const EncodedFrame& frame);
std::vector<std::uint8_t> encode_late_record(std::string_view session_id, const Items& items);
inline constexpr std::size_t kMaxLateHeadBytes = 2 + kMaxIdBytes + 1 + 4 + kFrameMetaBytes;

/// A peer's fault: what to log, and the code to answer with.
struct Fault {
  ErrorCode code{};
  std::string text;
};

template <class T>
using Parsed = boost::outcome_v2::basic_result<T, Fault, boost::outcome_v2::policy::terminate>;

/// Checks magic, layout, checksum, type and length (frames: kFrameMetaBytes + 1 .. kFrameMetaBytes
/// + max_jpeg_bytes). A stranger's first bytes are quoted in the fault.
Parsed<Header> parse_header(std::span<const std::uint8_t, kHeaderBytes> bytes,
                            std::uint32_t max_jpeg_bytes);

/// Bodies, as announced by a header of that type. The checksum is verified first. The whole body
/// must be used up. Ids, counts, reasons and text lengths are checked, versions only for min <=
/// max; control characters in texts become '?' (a calibration keeps tabs and line ends); an error
/// code that is not known becomes kRefused.
Parsed<Hello> parse_hello(const Header& header, std::span<const std::uint8_t> body);
Parsed<Welcome> parse_welcome(const Header& header, std::span<const std::uint8_t> body);
Parsed<Ack> parse_ack(const Header& header, std::span<const std::uint8_t> body);
Parsed<Items> parse_items(const Header& header, std::span<const std::uint8_t> body);
Parsed<Report> parse_stats(const Header& header, std::span<const std::uint8_t> body);
Parsed<Bye> parse_bye(const Header& header, std::span<const std::uint8_t> body);
Parsed<ErrorMessage> parse_error(const Header& header, std::span<const std::uint8_t> body);

/// Payloads, checked likewise. The bytes of a late part point into `payload`.
Parsed<std::vector<DropRecord>> parse_drops(std::span<const std::uint8_t> payload);
Parsed<LatePart> parse_late_part(std::span<const std::uint8_t> payload);
Parsed<Account> parse_account(std::span<const std::uint8_t> payload);
Parsed<LateFrame> parse_late_record(std::span<const std::uint8_t> record);

/// A frame's body arrives in two pieces so that the JPEG is never copied: the first
/// kFrameMetaBytes, and the rest. `jpeg` is moved into the frame.
Parsed<EncodedFrame> parse_frame(const Header& header,
                                 std::span<const std::uint8_t, kFrameMetaBytes> meta,
                                 std::vector<std::uint8_t> jpeg);

}  // namespace orbbuf::wire
