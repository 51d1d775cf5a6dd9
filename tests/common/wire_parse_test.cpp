// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <random>

#include "common/wire.hpp"
#include "tests/common/wire_samples.hpp"

namespace orbbuf::wire {
namespace {

Bytes sample(Type type) { return sample_messages().at(type); }

/// The sample of `type` with `value` stored at `offset` of its body, checksums made to fit.
template <class T>
Bytes altered(Type type, std::size_t offset, T value) {
  Bytes message = sample(type);
  store(&message.at(kHeaderBytes + offset), value);
  reseal(message);
  return message;
}

/// The sample's header with `value` stored at `offset` and a checksum that fits.
template <class T>
Bytes with_header(Type type, std::size_t offset, T value) {
  Bytes message = sample(type);
  store(&message.at(offset), value);
  store(&message[16], crc32(std::span(message).first(16)));
  return message;
}

Fault header_fault(std::span<const std::uint8_t> message) { return header_of(message).error(); }

TEST(WireParse, StrangersFirstBytesAreQuoted) {
  const Fault http = header_fault(bytes_of("GET / HTTP/1.1\r\nHost: x\r\n"));
  EXPECT_EQ(http.text, "not an ORBBuf peer: first bytes \"GET \" (47 45 54 20)");
  EXPECT_EQ(http.code, ErrorCode::kMalformed);
  const Fault tls =
      header_fault(Bytes{0x16, 3, 1, 0x02, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_EQ(tls.text, "not an ORBBuf peer: first bytes \"....\" (16 03 01 02)");
}

TEST(WireParse, EverySingleBitOfAHeaderMatters) {
  for (const auto& [type, message] : sample_messages()) {
    for (std::size_t bit = 0; bit < kHeaderBytes * 8; ++bit) {
      Bytes flipped = message;
      flipped[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
      EXPECT_FALSE(header_of(flipped)) << to_string(type) << ", bit " << bit;
    }
  }
}

TEST(WireParse, EverySingleBitOfABodyMatters) {
  for (const auto& [type, message] : sample_messages()) {
    for (std::size_t bit = kHeaderBytes * 8; bit < message.size() * 8; ++bit) {
      Bytes flipped = message;
      flipped[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
      EXPECT_EQ(fault_of(flipped),
                std::string(to_string(type)) + " body does not match its checksum");
    }
  }
}

TEST(WireParse, HeaderOfAnotherLayoutIsRefused) {
  EXPECT_EQ(fault_of(with_header(Type::kAck, 4, std::uint8_t{2})), "unknown header format 2");
  EXPECT_EQ(fault_of(with_header(Type::kAck, 5, std::uint8_t{0})), "unknown message type 0");
  EXPECT_EQ(fault_of(with_header(Type::kAck, 5, std::uint8_t{12})), "unknown message type 12");
  EXPECT_EQ(fault_of(with_header(Type::kAck, 6, std::uint16_t{1})),
            "reserved bytes of the header are not zero");
  Bytes corrupt = sample(Type::kAck);
  corrupt[9] = 1;
  EXPECT_EQ(fault_of(corrupt), "header does not match its checksum");
}

TEST(WireParse, HeaderThatClaimsFourGigabytesIsRefusedBeforeAnythingIsRead) {
  const auto claim = [](Type type) {
    return header_fault(with_header(type, 8, std::uint32_t{0xFFFFFFFF}));
  };
  EXPECT_EQ(claim(Type::kFrame).text,
            "frame body of 4294967295 bytes is over the limit of 1048616");
  EXPECT_EQ(claim(Type::kFrame).code, ErrorCode::kTooLarge);
  EXPECT_EQ(claim(Type::kHello).text, "hello body of 4294967295 bytes is over the limit of 65536");
  EXPECT_EQ(claim(Type::kHello).code, ErrorCode::kTooLarge);
}

TEST(WireParse, LengthsUpToTheLimitAreAccepted) {
  const auto accepts = [](Type type, std::uint32_t body_bytes) {
    return header_of(with_header(type, 8, body_bytes)).has_value();
  };
  EXPECT_TRUE(accepts(Type::kFrame, kFrameMetaBytes + kSampleMaxJpegBytes));
  EXPECT_FALSE(accepts(Type::kFrame, kFrameMetaBytes + kSampleMaxJpegBytes + 1));
  EXPECT_TRUE(accepts(Type::kFrame, kFrameMetaBytes + 1));
  EXPECT_TRUE(accepts(Type::kStats, kMaxControlBytes));
  EXPECT_FALSE(accepts(Type::kStats, kMaxControlBytes + 1));
}

TEST(WireParse, LimitOfAllJpegsDoesNotWrapAround) {
  const Bytes message = sample(Type::kFrame);
  EXPECT_TRUE(parse_header(std::span(message).first<kHeaderBytes>(), 0xFFFFFFFF));
}

TEST(WireParse, FrameWithoutJpegIsRefused) {
  EXPECT_EQ(fault_of(with_header(Type::kFrame, 8, std::uint32_t{40})),
            "frame body of 40 bytes holds no JPEG");
  const std::array<std::uint8_t, kFrameMetaBytes> meta{};
  const Header header{Type::kFrame, kFrameMetaBytes, crc32(meta)};
  EXPECT_EQ(parse_frame(header, meta, {}).error().text, "frame: no JPEG");
}

TEST(WireParse, BodyOfAnotherLengthThanAnnouncedIsRefused) {
  const Bytes message = sample(Type::kAck);
  const auto body = std::span(message).subspan(kHeaderBytes);
  EXPECT_EQ(parse_ack(header_of(message).value(), body.first(3)).error().text,
            "ack body has 3 bytes, its header says 24");
}

TEST(WireParse, MessageTruncatedAtAnyLengthIsRefused) {
  for (const auto& [type, message] : sample_messages()) {
    for (std::size_t size = 0; size < message.size(); ++size) {
      EXPECT_FALSE(there_and_back(std::span(message).first(size))) << to_string(type) << size;
    }
  }
}

TEST(WireParse, BodyThatEndsTooEarlyIsRefusedThoughItsChecksumFits) {
  for (const auto& [type, message] : sample_messages()) {
    const std::size_t end = type == Type::kFrame  ? kHeaderBytes + kFrameMetaBytes
                            : type == Type::kLate ? kHeaderBytes + kLateHeadBytes
                                                  : message.size() - 1;
    for (std::size_t size = kHeaderBytes; size <= end; ++size) {
      Bytes cut(message.begin(), message.begin() + static_cast<std::ptrdiff_t>(size));
      reseal(cut);
      EXPECT_FALSE(there_and_back(cut)) << to_string(type) << " of " << size << " bytes";
    }
  }
}

TEST(WireParse, BodyOfAWrongLengthIsNamed) {
  Bytes message = sample(Type::kStats);
  message.pop_back();
  reseal(message);
  EXPECT_EQ(fault_of(message), "stats ends too early");
  message.resize(message.size() + 4);
  reseal(message);
  EXPECT_EQ(fault_of(message), "stats has 3 bytes too many");
}

TEST(WireParse, BodyWithBytesLeftOverIsRefused) {
  for (const auto& [type, message] : sample_messages()) {
    if (type == Type::kFrame) continue;  // whatever follows the meta data is the JPEG
    Bytes longer = message;
    longer.push_back(0);
    reseal(longer);
    EXPECT_FALSE(there_and_back(longer)) << to_string(type);
  }
}

TEST(WireParse, HelloFieldsAreChecked) {
  EXPECT_EQ(fault_of(altered(Type::kHello, 0, std::uint8_t{6})), "hello: version range is empty");
  EXPECT_EQ(fault_of(altered(Type::kHello, 3, std::uint8_t{1})),
            "hello: reserved bytes are not zero");
  EXPECT_EQ(fault_of(altered(Type::kHello, 6, '/')), "hello: robot id \"/b3-07\" is not valid");
  EXPECT_EQ(fault_of(altered(Type::kHello, 6, '\n')), "hello: robot id \"?b3-07\" is not valid");
  EXPECT_EQ(fault_of(altered(Type::kHello, 14, '.')),
            "hello: session id \".0201024T101500Z\" is not valid");
  EXPECT_EQ(fault_of(altered(Type::kHello, 4, std::uint16_t{0xFFFF})), "hello ends too early");
}

TEST(WireParse, TextOverItsLimitIsRefused) {
  Hello hello{5, 5, "robot", "session", std::string(kMaxTextBytes, 's'), "0"};
  Bytes message = encode(hello);
  store(&message[kHeaderBytes + 20], static_cast<std::uint16_t>(kMaxTextBytes + 1));
  reseal(message);
  EXPECT_EQ(fault_of(message), "hello: software name of 1025 bytes is over the limit of 1024");
  EXPECT_EQ(there_and_back(message).error().code, ErrorCode::kTooLarge);
}

TEST(WireParse, HelloOfANewerVersionCanBeRead) {
  EXPECT_TRUE(there_and_back(altered(Type::kHello, 0, std::uint16_t{0x0207})));
}

TEST(WireParse, DroppedFieldsAreChecked) {
  EXPECT_EQ(fault_of(altered(Type::kDropped, 8, std::uint16_t{0})),
            "dropped: 0 records, not 1 to 1024");
  EXPECT_EQ(fault_of(altered(Type::kDropped, 8, std::uint16_t{1025})),
            "dropped: 1025 records, not 1 to 1024");
  EXPECT_EQ(fault_of(altered(Type::kDropped, 8, std::uint16_t{5})),
            "dropped: 76 bytes are not 5 records");
  EXPECT_EQ(fault_of(altered(Type::kDropped, 26, std::uint8_t{0})),
            "dropped: unknown drop reason 0");
  EXPECT_EQ(fault_of(altered(Type::kDropped, 26, std::uint8_t{8})),
            "dropped: unknown drop reason 8");
  EXPECT_EQ(fault_of(altered(Type::kDropped, 0, ~std::uint64_t{0})),
            "dropped: drop record number out of range");
  EXPECT_EQ(fault_of(altered(Type::kDropped, 10, ~std::uint64_t{0})),
            "dropped: sequence number out of range");
}

TEST(WireParse, DroppedHoldsAsManyRecordsAsItsLimit) {
  const Bytes message = encode(Dropped{0, std::vector<DropRecord>(kMaxDropsPerMessage)});
  EXPECT_LE(message.size() - kHeaderBytes, kMaxControlBytes);
  EXPECT_EQ(there_and_back(message).value(), message);
}

TEST(WireParse, FrameFieldsAreChecked) {
  EXPECT_EQ(fault_of(altered(Type::kFrame, 24, std::uint8_t{2})),
            "frame: unknown image encoding 2");
  EXPECT_EQ(fault_of(altered(Type::kFrame, 27, std::uint8_t{1})),
            "frame: reserved bytes are not zero");
  EXPECT_EQ(fault_of(altered(Type::kFrame, 0, ~std::uint64_t{0})),
            "frame: sequence number out of range");
}

TEST(WireParse, AQualityIsAtMost100) {
  const auto with_quality = [](std::uint8_t quality) {
    return fault_of(altered(Type::kFrame, 25, quality));
  };
  EXPECT_EQ(with_quality(0), "accepted");
  EXPECT_EQ(with_quality(100), "accepted");
  EXPECT_EQ(with_quality(101), "frame: quality 101");
  EXPECT_EQ(with_quality(255), "frame: quality 255");
}

TEST(WireParse, AReducedFrameIsSmallerThanTheWholeOne) {
  const auto reduced_from = [](std::uint32_t bytes) {
    return fault_of(altered(Type::kFrame, 32, bytes));
  };
  EXPECT_EQ(reduced_from(1), "frame: reduced from 1 bytes to 11");
  EXPECT_EQ(reduced_from(11), "frame: reduced from 11 bytes to 11");
  EXPECT_EQ(reduced_from(12), "accepted");
  EXPECT_EQ(reduced_from(0xFFFFFFFF), "accepted");
}

TEST(WireParse, AWholeFrameHasNoChecksumOfAnother) {
  EXPECT_EQ(fault_of(altered(Type::kFrame, 32, std::uint32_t{0})),
            "frame: reduced from 0 bytes to 11");
  EXPECT_EQ(fault_of(altered(Type::kFrame, 32, std::uint64_t{0})), "accepted");
}

TEST(WireParse, ALateFrameIsWhole) {
  EXPECT_EQ(parse_late_record(encode_late_record("s1", reduced_frame())).error().text,
            "late frame: it is not whole");
}

TEST(WireParse, TheLeftImageIsAtLeastAByteAndAtMostAll) {
  const auto with_left_bytes = [](std::uint32_t bytes) {
    return fault_of(altered(Type::kFrame, 28, bytes));
  };
  EXPECT_EQ(with_left_bytes(0), "frame: left image of 0 bytes, of 11");
  EXPECT_EQ(with_left_bytes(1), "accepted");
  EXPECT_EQ(with_left_bytes(11), "accepted");
  EXPECT_EQ(with_left_bytes(12), "frame: left image of 12 bytes, of 11");
  EXPECT_EQ(with_left_bytes(0xFFFFFFFF), "frame: left image of 4294967295 bytes, of 11");
}

TEST(WireParse, WelcomeReservedBytesAreChecked) {
  EXPECT_EQ(fault_of(altered(Type::kWelcome, 3, std::uint8_t{1})),
            "welcome: reserved bytes are not zero");
}

TEST(WireParse, WelcomeReservedBitsAreChecked) {
  EXPECT_EQ(fault_of(altered(Type::kWelcome, 1, std::uint8_t{3})), "accepted");
  EXPECT_EQ(fault_of(altered(Type::kWelcome, 1, std::uint8_t{4})),
            "welcome: reserved bits are not zero");
}

TEST(WireParse, ALatePartIsWithinItsRecord) {
  EXPECT_EQ(fault_of(altered(Type::kLate, 8, std::uint32_t{2})), "accepted");
  EXPECT_EQ(fault_of(altered(Type::kLate, 8, std::uint32_t{4})),
            "late: 4 bytes from 4 on are no part of 7");
  EXPECT_EQ(fault_of(altered(Type::kLate, 8, std::uint32_t{0xFFFFFFFF})),
            "late: 4 bytes from 4294967295 on are no part of 7");
  EXPECT_EQ(fault_of(altered(Type::kLate, 12, std::uint32_t{6})),
            "late: 4 bytes from 3 on are no part of 6");
}

TEST(WireParse, SpoolFieldsAreChecked) {
  EXPECT_EQ(fault_of(altered(Type::kSpool, 0, std::uint16_t{kMaxSpooledSessions + 1})),
            "spool: 501 sessions are more than 500");
  EXPECT_EQ(fault_of(altered(Type::kSpool, 0, std::uint16_t{3})),
            "spool: fewer sessions than announced");
  EXPECT_EQ(fault_of(altered(Type::kSpool, 4, std::uint8_t{'/'})),
            "spool: session id \"/1\" is not valid");
  EXPECT_EQ(fault_of(altered(Type::kSpool, 6, std::uint64_t{0})),
            "spool: a session without frames");
}

TEST(WireParse, ASpoolMayHoldAsManySessionsAsItsLimit) {
  Spool spool;
  const std::string name(kMaxIdBytes, 'x');
  for (std::size_t i = 0; i < kMaxSpooledSessions; ++i) spool.sessions.push_back({name, 1, 2});
  EXPECT_EQ(there_and_back(encode(spool)).value(), encode(spool));
  EXPECT_EQ(there_and_back(encode(Spool{})).value(), encode(Spool{}));
}

TEST(WireParse, ALateRecordIsChecked) {
  const Bytes record = encode_late_record("s1", sample_frame());
  for (std::size_t size = 0; size < record.size(); ++size) {
    EXPECT_FALSE(parse_late_record(std::span(record).first(size))) << size;
  }
  for (std::size_t bit = 0; bit < record.size() * 8; ++bit) {
    Bytes damaged = record;
    damaged[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    const auto late = parse_late_record(damaged);
    const bool is_other_session =
        late && late.value().session_id != "s1";  // no checksum of its own
    EXPECT_TRUE(!late || is_other_session) << bit;
  }
  Bytes other = record;
  other[2] = '/';
  EXPECT_EQ(parse_late_record(other).error().text, "late frame: session id \"/1\" is not valid");
}

TEST(WireParse, WhatIsReceivedIsAtLeastWhatIsKept) {
  EXPECT_EQ(fault_of(altered(Type::kAck, 16, std::uint64_t{7})), "accepted");
  EXPECT_EQ(fault_of(altered(Type::kAck, 16, std::uint64_t{6})),
            "ack: received is below next_sequence");
}

TEST(WireParse, UnknownErrorCodeCountsAsRefused) {
  for (const std::uint16_t code : std::initializer_list<std::uint16_t>{0, 9, 0xFFFF}) {
    const Bytes message = altered(Type::kError, 0, code);
    const auto body = std::span(message).subspan(kHeaderBytes);
    const auto error = parse_error(header_of(message).value(), body);
    EXPECT_EQ(error.value(), (ErrorMessage{ErrorCode::kRefused, "no version in common"}));
  }
}

TEST(WireParse, MovedIsAnErrorWithAnAddress) {
  const ErrorMessage moved{ErrorCode::kMoved, "b:7722"};
  const Bytes message = encode(moved);
  EXPECT_EQ(message[kHeaderBytes + 1], 8);
  const auto again =
      parse_error(header_of(message).value(), std::span(message).subspan(kHeaderBytes));
  ASSERT_TRUE(again) << again.error().text;
  EXPECT_EQ(again.value(), moved);
}

/// One to four small damages: a flipped bit, a changed byte, bytes cut off or put in.
void damage(Bytes& message, std::mt19937& random) {
  const auto below = [&](std::size_t limit) { return static_cast<std::size_t>(random()) % limit; };
  for (std::size_t left = 1 + below(4); left > 0 && !message.empty(); --left) {
    const auto at = message.begin() + static_cast<std::ptrdiff_t>(below(message.size()));
    const auto rest = static_cast<std::size_t>(message.end() - at);
    switch (below(4)) {
      case 0:
        *at ^= static_cast<std::uint8_t>(1U << below(8));
        break;
      case 1:
        *at = static_cast<std::uint8_t>(below(2) == 0 ? 0xFF : random());
        break;
      case 2:
        message.erase(at,
                      at + static_cast<std::ptrdiff_t>(1 + below(std::min<std::size_t>(4, rest))));
        break;
      default:
        message.insert(at, 1 + below(4), static_cast<std::uint8_t>(random()));
    }
  }
}

TEST(WireParse, DamagedMessageIsNeverAcceptedWithChangedContent) {
  const auto samples = sample_messages();
  std::mt19937 random(20201024);
  for (int i = 0; i < 100'000; ++i) {
    const Bytes& original = std::next(samples.begin(), i % 11)->second;
    Bytes message = original;
    damage(message, random);
    const auto again = there_and_back(message);
    ASSERT_TRUE(!again || again.value() == original) << i << ": " << hex(message);
  }
}

TEST(WireParse, DamageUnderFittingChecksumsIsRefusedOrReadInOneWayOnly) {
  const auto samples = sample_messages();
  std::mt19937 random(14861);
  int accepted = 0;
  for (int i = 0; i < 100'000; ++i) {
    Bytes message = std::next(samples.begin(), i % 11)->second;
    Bytes body(message.begin() + kHeaderBytes, message.end());
    damage(body, random);
    message.resize(kHeaderBytes);
    message.insert(message.end(), body.begin(), body.end());
    reseal(message);
    const auto once = there_and_back(message);
    if (!once) continue;
    ++accepted;
    ASSERT_EQ(fault_of(once.value()), "accepted") << i << ": " << hex(message);
    ASSERT_EQ(there_and_back(once.value()).value(), once.value()) << i << ": " << hex(message);
  }
  EXPECT_GT(accepted, 1000);
}

}  // namespace
}  // namespace orbbuf::wire
