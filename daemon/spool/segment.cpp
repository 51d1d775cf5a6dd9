// SPDX-License-Identifier: Apache-2.0
#include "daemon/spool/segment.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <initializer_list>
#include <memory>
#include <span>
#include <tuple>

#include "common/byte_order.hpp"
#include "common/wire.hpp"

namespace orbbuf {
namespace {

constexpr std::uint32_t kHeaderMagic = 0x4F425350;  // "OBSP"
constexpr std::uint32_t kRecordMagic = 0x4F425352;  // "OBSR"
constexpr std::uint32_t kFooterMagic = 0x4F425345;  // "OBSE"
constexpr std::uint16_t kVersion = 2;
constexpr std::size_t kCrcBytes = 4;
constexpr std::size_t kMaxHeaderBytes = 4 + 2 + 2 * (2 + wire::kMaxIdBytes) + 8 + kCrcBytes;

using Bytes = std::span<const std::uint8_t>;

std::vector<std::uint8_t> to_bytes(const SegmentHeader& header) {
  wire::Writer writer(0);
  writer.put(kHeaderMagic);
  writer.put(kVersion);
  writer.put_text(header.robot_id);
  writer.put_text(header.session_id);
  writer.put(header.number);
  writer.put(wire::crc32(writer.bytes()));
  return std::move(writer.bytes());
}

/// `header_crc`: the checksum of the segment's header, without its last field.
std::vector<std::uint8_t> record_head(const EncodedFrame& frame, std::uint32_t header_crc) {
  wire::Writer writer(0);
  writer.put(kRecordMagic);
  writer.put(static_cast<std::uint32_t>(frame.jpeg.size()));
  writer.put(frame.sequence);
  writer.put(frame.capture_time_ns);
  writer.put(frame.exposure_ns);
  writer.put(frame.width_px);
  writer.put(frame.height_px);
  writer.put(frame.left_bytes);
  writer.put(frame.jpeg_crc);
  writer.put(frame.quality);
  writer.put(wire::crc32(writer.bytes(), header_crc));
  return std::move(writer.bytes());
}

std::vector<std::uint8_t> to_bytes(const FrameRange& range, std::uint32_t header_crc) {
  wire::Writer writer(0);
  writer.put(kFooterMagic);
  writer.put(range.frames);
  writer.put(range.first);
  writer.put(range.last);
  writer.put(wire::crc32(writer.bytes(), header_crc));
  return std::move(writer.bytes());
}

bool is_checked(Bytes bytes, std::uint32_t header_crc) {
  const auto content = bytes.first(bytes.size() - kCrcBytes);
  return wire::crc32(content, header_crc) ==
         wire::load<std::uint32_t>(content.data() + content.size());
}

/// 0, or the error.
int write_all(int file, std::initializer_list<Bytes> parts, std::uint64_t offset) {
  for (Bytes part : parts) {
    while (!part.empty()) {
      const ssize_t done = ::pwrite(file, part.data(), part.size(), static_cast<off_t>(offset));
      if (done < 0 && errno == EINTR) continue;
      if (done <= 0) return done < 0 ? errno : ENOSPC;
      part = part.subspan(static_cast<std::size_t>(done));
      offset += static_cast<std::uint64_t>(done);
    }
  }
  return 0;
}

/// How many bytes there were; nothing on an error, which is in errno.
std::optional<std::size_t> read_some(int file, std::span<std::uint8_t> into, std::uint64_t offset) {
  std::size_t done = 0;
  while (done < into.size()) {
    const ssize_t here =
        ::pread(file, into.data() + done, into.size() - done, static_cast<off_t>(offset + done));
    if (here < 0 && errno == EINTR) continue;
    if (here < 0) return std::nullopt;
    if (here == 0) break;
    done += static_cast<std::size_t>(here);
  }
  return done;
}

bool read_all(int file, std::span<std::uint8_t> into, std::uint64_t offset) {
  errno = EIO;  // if there are too few bytes
  return read_some(file, into, offset) == into.size();
}

/// The header at the begin of `bytes`, and its length.
std::optional<std::pair<SegmentHeader, std::size_t>> parse_header(Bytes bytes) {
  wire::Reader reader(bytes);
  if (reader.take<std::uint32_t>() != kHeaderMagic || reader.take<std::uint16_t>() != kVersion) {
    return std::nullopt;
  }
  SegmentHeader header;
  header.robot_id = reader.take_text();
  header.session_id = reader.take_text();
  header.number = reader.take<std::uint64_t>();
  reader.take<std::uint32_t>();
  if (reader.is_short()) return std::nullopt;
  const std::size_t length = bytes.size() - reader.left();
  if (!is_checked(bytes.first(length), 0)) return std::nullopt;
  if (!wire::is_valid_id(header.robot_id) || !wire::is_valid_id(header.session_id)) {
    return std::nullopt;
  }
  return std::pair(std::move(header), length);
}

}  // namespace

void FrameRange::add(Sequence sequence) { add(FrameRange{1, sequence, sequence}); }

void FrameRange::add(const FrameRange& other) {
  if (other.frames == 0) return;
  first = frames == 0 ? other.first : std::min(first, other.first);
  last = frames == 0 ? other.last : std::max(last, other.last);
  frames += other.frames;
}

Result<SegmentWriter> SegmentWriter::create(const std::filesystem::path& file,
                                            const SegmentHeader& header) {
  constexpr mode_t kMode = 0600;
  const std::string attempt = "cannot make " + file.string();
  SegmentWriter writer(
      file, UniqueFd(::open(file.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, kMode)));
  if (!writer.file_) return system_error(attempt, errno);
  const auto bytes = to_bytes(header);
  if (const int failed = write_all(writer.file_.get(), {bytes}, 0)) {
    ::unlink(file.c_str());
    return system_error(attempt, failed);
  }
  writer.bytes_ = bytes.size();
  writer.header_crc_ = wire::load<std::uint32_t>(bytes.data() + bytes.size() - kCrcBytes);
  return writer;
}

Result<SegmentRecord> SegmentWriter::append(const EncodedFrame& frame) {
  const auto head = record_head(frame, header_crc_);
  if (const int failed = write_all(file_.get(), {head, frame.jpeg}, bytes_)) return undo(failed);
  const SegmentRecord record{bytes_, static_cast<std::uint32_t>(frame.jpeg.size()), frame.sequence};
  bytes_ = record.end();
  range_.add(frame.sequence);
  return record;
}

std::optional<Error> SegmentWriter::sync() {
  if (::fdatasync(file_.get()) == 0) return std::nullopt;
  return system_error("cannot sync " + path_.string(), errno);
}

std::optional<Error> SegmentWriter::complete() {
  if (auto failed = add_footer()) return failed;
  return sync();
}

std::optional<Error> SegmentWriter::add_footer() {
  const auto footer = to_bytes(range_, header_crc_);
  if (const int failed = write_all(file_.get(), {footer}, bytes_)) return undo(failed);
  bytes_ += footer.size();
  return std::nullopt;
}

Error SegmentWriter::undo(int error_number) {
  is_broken_ = ::ftruncate(file_.get(), static_cast<off_t>(bytes_)) != 0;
  return system_error("cannot write " + path_.string(), error_number);
}

Result<SegmentReader> SegmentReader::open(const std::filesystem::path& file) {
  const std::string attempt = "cannot read " + file.string();
  SegmentReader reader(file, UniqueFd(::open(file.c_str(), O_RDWR | O_CLOEXEC)));
  struct stat found {};
  if (!reader.file_ || ::fstat(reader.file_.get(), &found) != 0)
    return system_error(attempt, errno);
  reader.bytes_ = static_cast<std::uint64_t>(found.st_size);
  std::array<std::uint8_t, kMaxHeaderBytes> bytes{};
  const auto count = read_some(reader.file_.get(), bytes, 0);
  if (!count) return system_error(attempt, errno);
  auto parsed = parse_header(Bytes(bytes).first(*count));
  if (!parsed) return Error{attempt + ": it is not a segment of version 2"};
  std::tie(reader.header_, reader.header_bytes_) = std::move(*parsed);
  reader.header_crc_ = wire::load<std::uint32_t>(bytes.data() + reader.header_bytes_ - kCrcBytes);
  return reader;
}

std::optional<FrameRange> SegmentReader::footer() const {
  if (bytes_ < header_bytes_ + kFooterBytes) return std::nullopt;
  std::array<std::uint8_t, kFooterBytes> bytes{};
  if (!read_all(file_.get(), bytes, bytes_ - kFooterBytes)) return std::nullopt;
  wire::Reader reader(bytes);
  if (reader.take<std::uint32_t>() != kFooterMagic || !is_checked(bytes, header_crc_)) {
    return std::nullopt;
  }
  FrameRange range;
  range.frames = reader.take<std::uint64_t>();
  range.first = reader.take<std::uint64_t>();
  range.last = reader.take<std::uint64_t>();
  return range;
}

std::vector<SegmentRecord> SegmentReader::scan() const {
  std::vector<SegmentRecord> records;
  std::uint64_t offset = header_bytes_;
  while (offset + kRecordHeadBytes < bytes_) {
    auto record = record_at(offset);
    if (!record) record = record_after(offset);
    if (!record) break;
    records.push_back(*record);
    offset = record->end();
  }
  return records;
}

std::optional<SegmentRecord> SegmentReader::record_at(std::uint64_t offset) const {
  std::array<std::uint8_t, kRecordHeadBytes> head{};
  if (!read_all(file_.get(), head, offset)) return std::nullopt;
  wire::Reader reader(head);
  if (reader.take<std::uint32_t>() != kRecordMagic || !is_checked(head, header_crc_)) {
    return std::nullopt;
  }
  SegmentRecord record;
  record.offset = offset;
  record.jpeg_bytes = reader.take<std::uint32_t>();
  record.sequence = reader.take<std::uint64_t>();
  if (record.jpeg_bytes == 0 || record.end() > bytes_) return std::nullopt;
  return record;
}

/// The next one that begins after `offset`, which is that of a bad one.
std::optional<SegmentRecord> SegmentReader::record_after(std::uint64_t offset) const {
  std::array<std::uint8_t, sizeof kRecordMagic> magic{};
  wire::store(magic.data(), kRecordMagic);
  std::vector<std::uint8_t> bytes(std::size_t{256} * 1024);
  for (std::uint64_t begin = offset + 1; begin + kRecordHeadBytes < bytes_;) {
    const auto count = read_some(file_.get(), bytes, begin);
    const auto end = bytes.begin() + static_cast<std::ptrdiff_t>(count.value_or(0));
    for (auto at = bytes.begin(); at != end; ++at) {
      at = std::search(at, end, magic.begin(), magic.end());
      if (at == end) break;
      const auto record = record_at(begin + static_cast<std::uint64_t>(at - bytes.begin()));
      if (record) return record;
    }
    // A magic may begin in one part and end in the next. An unreadable part is passed over.
    begin += bytes.size() - (magic.size() - 1);
  }
  return std::nullopt;
}

Result<FramePtr> SegmentReader::read(const SegmentRecord& record) const {
  const auto fail = [&](const std::string& why) {
    return Error{"cannot read frame " + std::to_string(record.sequence) + " in " + path_.string() +
                 ": " + why};
  };
  std::array<std::uint8_t, kRecordHeadBytes> head{};
  auto frame = std::make_shared<EncodedFrame>();
  frame->jpeg.resize(record.jpeg_bytes);
  if (!read_all(file_.get(), head, record.offset) ||
      !read_all(file_.get(), frame->jpeg, record.offset + kRecordHeadBytes)) {
    return fail(system_error("", errno).text);
  }
  wire::Reader reader(head);
  const bool is_record =
      reader.take<std::uint32_t>() == kRecordMagic && is_checked(head, header_crc_);
  const auto jpeg_bytes = reader.take<std::uint32_t>();
  frame->sequence = reader.take<std::uint64_t>();
  frame->capture_time_ns = reader.take<std::int64_t>();
  frame->exposure_ns = reader.take<std::uint32_t>();
  frame->width_px = reader.take<std::uint16_t>();
  frame->height_px = reader.take<std::uint16_t>();
  frame->left_bytes = reader.take<std::uint32_t>();
  frame->jpeg_crc = reader.take<std::uint32_t>();
  frame->quality = reader.take<std::uint8_t>();
  if (!is_record || jpeg_bytes != record.jpeg_bytes || frame->sequence != record.sequence ||
      wire::crc32(frame->jpeg) != frame->jpeg_crc) {
    return fail("its checksum is wrong");
  }
  return FramePtr(std::move(frame));
}

std::optional<Error> SegmentReader::complete(const std::vector<SegmentRecord>& records) {
  SegmentWriter writer(path_, UniqueFd(::dup(file_.get())));
  writer.bytes_ = records.empty() ? header_bytes_ : records.back().end();
  writer.header_crc_ = header_crc_;
  for (const SegmentRecord& record : records) writer.range_.add(record.sequence);
  if (::ftruncate(file_.get(), static_cast<off_t>(writer.bytes_)) != 0) return writer.undo(errno);
  auto failed = writer.add_footer();
  bytes_ = writer.bytes();
  return failed;
}

}  // namespace orbbuf
