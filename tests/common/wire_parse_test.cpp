// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <random>

#include "common/wire.hpp"
#include "tests/common/wire_samples.hpp"

namespace orbbuf::wire {
namespace {

/// Of the bodies of items.
constexpr std::size_t kItemsHeadBytes = 10;

Bytes sample(const std::string& name) { return sample_messages().at(name); }

/// The sample of that name with `value` stored at `offset` of its body, checksums made to fit.
template <class T>
Bytes altered(const std::string& name, std::size_t offset, T value) {
  Bytes message = sample(name);
  store(&message.at(kHeaderBytes + offset), value);
  reseal(message);
  return message;
}

/// The sample's header with `value` stored at `offset` and a checksum that fits.
template <class T>
Bytes with_header(const std::string& name, std::size_t offset, T value) {
  Bytes message = sample(name);
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
  EXPECT_EQ(tls.text,
            "the peer speaks TLS, and this end does not: set [tls] here, or remove it there");
}

TEST(WireParse, EverySingleBitOfAHeaderMatters) {
  for (const auto& [name, message] : sample_messages()) {
    for (std::size_t bit = 0; bit < kHeaderBytes * 8; ++bit) {
      Bytes flipped = message;
      flipped[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
      EXPECT_FALSE(header_of(flipped)) << name << ", bit " << bit;
    }
  }
}

TEST(WireParse, EverySingleBitOfABodyMatters) {
  for (const auto& [name, message] : sample_messages()) {
    const std::string type(to_string(header_of(message).value().type));
    for (std::size_t bit = kHeaderBytes * 8; bit < message.size() * 8; ++bit) {
      Bytes flipped = message;
      flipped[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
      EXPECT_EQ(fault_of(flipped), type + " body does not match its checksum") << name;
    }
  }
}

TEST(WireParse, HeaderOfAnotherLayoutIsRefused) {
  EXPECT_EQ(fault_of(with_header("ack", 4, std::uint8_t{2})), "unknown header format 2");
  EXPECT_EQ(fault_of(with_header("ack", 5, std::uint8_t{0})), "unknown message type 0");
  EXPECT_EQ(fault_of(with_header("ack", 5, std::uint8_t{9})), "unknown message type 9");
  EXPECT_EQ(fault_of(with_header("ack", 6, std::uint16_t{1})),
            "reserved bytes of the header are not zero");
  Bytes corrupt = sample("ack");
  corrupt[9] = 1;
  EXPECT_EQ(fault_of(corrupt), "header does not match its checksum");
}

TEST(WireParse, HeaderThatClaimsFourGigabytesIsRefusedBeforeAnythingIsRead) {
  const auto claim = [](const char* name) {
    return header_fault(with_header(name, 8, std::uint32_t{0xFFFFFFFF}));
  };
  EXPECT_EQ(claim("frame").text, "frame body of 4294967295 bytes is over the limit of 1048616");
  EXPECT_EQ(claim("frame").code, ErrorCode::kTooLarge);
  EXPECT_EQ(claim("hello").text, "hello body of 4294967295 bytes is over the limit of 65536");
  EXPECT_EQ(claim("hello").code, ErrorCode::kTooLarge);
}

TEST(WireParse, LengthsUpToTheLimitAreAccepted) {
  const auto accepts = [](const char* name, std::uint32_t body_bytes) {
    return header_of(with_header(name, 8, body_bytes)).has_value();
  };
  EXPECT_TRUE(accepts("frame", kFrameMetaBytes + kSampleMaxJpegBytes));
  EXPECT_FALSE(accepts("frame", kFrameMetaBytes + kSampleMaxJpegBytes + 1));
  EXPECT_TRUE(accepts("frame", kFrameMetaBytes + 1));
  EXPECT_TRUE(accepts("stats", kMaxControlBytes));
  EXPECT_FALSE(accepts("stats", kMaxControlBytes + 1));
}

TEST(WireParse, LimitOfAllJpegsDoesNotWrapAround) {
  const Bytes message = sample("frame");
  EXPECT_TRUE(parse_header(std::span(message).first<kHeaderBytes>(), 0xFFFFFFFF));
}

TEST(WireParse, FrameWithoutJpegIsRefused) {
  EXPECT_EQ(fault_of(with_header("frame", 8, std::uint32_t{40})),
            "frame body of 40 bytes holds no JPEG");
  const std::array<std::uint8_t, kFrameMetaBytes> meta{};
  const Header header{Type::kFrame, kFrameMetaBytes, crc32(meta)};
  EXPECT_EQ(parse_frame(header, meta, {}).error().text, "frame: no JPEG");
}

TEST(WireParse, BodyOfAnotherLengthThanAnnouncedIsRefused) {
  const Bytes message = sample("ack");
  const auto body = std::span(message).subspan(kHeaderBytes);
  EXPECT_EQ(parse_ack(header_of(message).value(), body.first(3)).error().text,
            "ack body has 3 bytes, its header says 40");
}

TEST(WireParse, MessageTruncatedAtAnyLengthIsRefused) {
  for (const auto& [name, message] : sample_messages()) {
    for (std::size_t size = 0; size < message.size(); ++size) {
      EXPECT_FALSE(there_and_back(std::span(message).first(size))) << name << size;
    }
  }
}

TEST(WireParse, BodyThatEndsTooEarlyIsRefusedThoughItsChecksumFits) {
  // What these have at their end may have any length, from a byte on.
  const std::map<std::string, std::size_t> heads = {
      {"frame", kFrameMetaBytes}, {"late", kItemsHeadBytes + 8}, {"other", kItemsHeadBytes}};
  for (const auto& [name, message] : sample_messages()) {
    const auto head = heads.find(name);
    const std::size_t end = head == heads.end() ? message.size() - 1 : kHeaderBytes + head->second;
    for (std::size_t size = kHeaderBytes; size <= end; ++size) {
      Bytes cut(message.begin(), message.begin() + static_cast<std::ptrdiff_t>(size));
      reseal(cut);
      EXPECT_FALSE(there_and_back(cut)) << name << " of " << size << " bytes";
    }
  }
}

TEST(WireParse, BodyOfAWrongLengthIsNamed) {
  Bytes message = sample("stats");
  message.pop_back();
  reseal(message);
  EXPECT_EQ(fault_of(message), "stats ends too early");
  message.resize(message.size() + 4);
  reseal(message);
  EXPECT_EQ(fault_of(message), "stats has 3 bytes too many");
}

TEST(WireParse, BodyWithBytesLeftOverIsRefused) {
  for (const auto& [name, message] : sample_messages()) {
    if (name == "frame" || name == "other") continue;  // whatever follows the head is theirs
    Bytes longer = message;
    longer.push_back(0);
    reseal(longer);
    EXPECT_FALSE(there_and_back(longer)) << name;
  }
}

TEST(WireParse, HelloFieldsAreChecked) {
  EXPECT_EQ(fault_of(altered("hello", 0, std::uint8_t{8})), "hello: version range is empty");
  EXPECT_EQ(fault_of(altered("hello", 3, std::uint8_t{1})), "hello: reserved bytes are not zero");
  EXPECT_EQ(fault_of(altered("hello", 6, '/')), "hello: robot id \"/b3-07\" is not valid");
  EXPECT_EQ(fault_of(altered("hello", 6, '\n')), "hello: robot id \"?b3-07\" is not valid");
  EXPECT_EQ(fault_of(altered("hello", 14, '.')),
            "hello: session id \".0201024T101500Z\" is not valid");
  EXPECT_EQ(fault_of(altered("hello", 4, std::uint16_t{0xFFFF})), "hello ends too early");
}

TEST(WireParse, TextOverItsLimitIsRefused) {
  const Hello hello{6, 6, "robot", "session", std::string(kMaxTextBytes, 's'), "0", {}};
  Bytes message = encode(hello);
  store(&message[kHeaderBytes + 20], static_cast<std::uint16_t>(kMaxTextBytes + 1));
  reseal(message);
  EXPECT_EQ(fault_of(message), "hello: software name of 1025 bytes is over the limit of 1024");
  EXPECT_EQ(there_and_back(message).error().code, ErrorCode::kTooLarge);
}

TEST(WireParse, HelloOfANewerVersionCanBeRead) {
  EXPECT_TRUE(there_and_back(altered("hello", 0, std::uint16_t{0x0207})));
}

/// What is wrong with a hello that declares these.
std::string fault_of_streams(std::vector<StreamDeclaration> streams) {
  return fault_of(encode(Hello{6, 6, "robot", "session", "orbbufd", "", std::move(streams)}));
}

TEST(WireParse, AHelloDeclaresStreamsFromTheFourthOnInOrder) {
  EXPECT_EQ(fault_of_streams({{3, "a", "x"}}), "hello: stream 3, not 4 to 31");
  EXPECT_EQ(fault_of_streams({{4, "a", "x"}, {31, "b", "x"}}), "accepted");
  EXPECT_EQ(fault_of_streams({{32, "a", "x"}}), "hello: stream 32, not 4 to 31");
  EXPECT_EQ(fault_of_streams({{5, "a", "x"}, {5, "b", "x"}}), "hello: stream 5, not 6 to 31");
  EXPECT_EQ(fault_of_streams({{5, "a", "x"}, {4, "b", "x"}}), "hello: stream 4, not 6 to 31");
}

TEST(WireParse, AHelloMayDeclareAllStreams) {
  std::vector<StreamDeclaration> all;
  for (StreamId id = kFirstOther; id < kMostStreams; ++id) {
    std::string name(kMaxNameBytes, 'n');
    name.back() = static_cast<char>('A' + id);
    all.push_back({id, name, std::string(kMaxNameBytes, 'c')});
  }
  EXPECT_EQ(fault_of_streams(all), "accepted");
  all.push_back({kMostStreams, "one more", "x"});
  EXPECT_EQ(fault_of_streams(all), "hello: stream 32, not 32 to 31");
}

TEST(WireParse, EachStreamHasANameOfItsOwn) {
  EXPECT_EQ(fault_of_streams({{4, "", "x"}}),
            "hello: stream 4: its name \"\" is empty or another stream's");
  EXPECT_EQ(fault_of_streams({{4, "a", "x"}, {5, "b", ""}}), "accepted");
  EXPECT_EQ(fault_of_streams({{4, "a", "x"}, {5, "b", "x"}, {6, "a", "y"}}),
            "hello: stream 6: its name \"a\" is empty or another stream's");
  EXPECT_EQ(fault_of_streams({{4, "a\n", "x"}, {5, "a\r", "y"}}),
            "hello: stream 5: its name \"a?\" is empty or another stream's");
}

TEST(WireParse, NamesOfStreamsOverTheirLimitAreRefused) {
  const auto with_length = [](std::size_t offset, std::uint16_t length) {
    const Hello hello{6,
                      6,
                      "r",
                      "s",
                      "",
                      "",
                      {{4, std::string(kMaxNameBytes, 'n'), std::string(kMaxNameBytes, 'c')}}};
    Bytes message = encode(hello);
    store(&message.at(kHeaderBytes + 18 + offset), length);
    message.insert(message.end(), length - kMaxNameBytes, 'x');
    reseal(message);
    return fault_of(message);
  };
  EXPECT_EQ(with_length(0, kMaxNameBytes), "accepted");
  EXPECT_EQ(with_length(0, kMaxNameBytes + 1),
            "hello: name of a stream of 129 bytes is over the limit of 128");
  EXPECT_EQ(with_length(2 + kMaxNameBytes, kMaxNameBytes + 1),
            "hello: codec of 129 bytes is over the limit of 128");
}

TEST(WireParse, DropFieldsAreChecked) {
  const auto with = [](std::size_t offset, auto value) {
    return fault_of(altered("drops", kItemsHeadBytes + offset, value));
  };
  EXPECT_EQ(with(0, std::uint16_t{0}), "drop records: 0 records, not 1 to 1024");
  EXPECT_EQ(with(0, std::uint16_t{1025}), "drop records: 1025 records, not 1 to 1024");
  EXPECT_EQ(with(0, std::uint16_t{2}), "drop records: 105 bytes are not 2 records");
  EXPECT_EQ(with(0, std::uint16_t{4}), "drop records: 105 bytes are not 4 records");
  EXPECT_EQ(with(2, ~std::uint64_t{0}), "drop records: sequence number out of range");
  EXPECT_EQ(with(2, ~std::uint64_t{0} - 1), "accepted");
  EXPECT_EQ(with(10, std::uint64_t{0}), "drop records: 0 frames from 10 on");
  EXPECT_EQ(with(10, ~std::uint64_t{0} - 10), "accepted");
  EXPECT_EQ(with(10, ~std::uint64_t{0} - 9),
            "drop records: 18446744073709551606 frames from 10 on");
  EXPECT_EQ(with(34, std::uint8_t{0}), "drop records: unknown drop reason 0");
  EXPECT_EQ(with(34, std::uint8_t{7}), "accepted");
  EXPECT_EQ(with(34, std::uint8_t{8}), "drop records: unknown drop reason 8");
  EXPECT_EQ(with(2 + 2 * 35 + 32, std::uint8_t{8}), "drop records: unknown drop reason 8");
}

TEST(WireParse, AMessageHoldsAsManyDropRecordsAsTheirLimit) {
  const std::vector<DropRecord> most(kMaxDropsPerMessage);
  const Bytes drops = encode(Items{kDrops, 0, encode_drops(most)});
  EXPECT_EQ(there_and_back(drops).value(), drops);
  const Account account{std::string(kMaxIdBytes, 'x'), true, true, 1, 0, 0, 0, 0, most};
  const Bytes accounts = encode(Items{kAccounts, 0, encode_account(account)});
  EXPECT_LE(accounts.size() - kHeaderBytes, kMaxControlBytes);
  EXPECT_EQ(there_and_back(accounts).value(), accounts);
}

TEST(WireParse, ItemsAreOfAStreamOfTheirOwn) {
  const auto of_stream = [](StreamId id) { return fault_of(altered("other", 0, id)); };
  EXPECT_EQ(of_stream(0), "items: of stream 0");
  EXPECT_EQ(of_stream(31), "accepted");
  EXPECT_EQ(of_stream(32), "items: of stream 32");
  EXPECT_EQ(of_stream(0xFFFF), "items: of stream 65535");
}

TEST(WireParse, ThereIsANumberBehindThatOfAnItem) {
  EXPECT_EQ(fault_of(altered("other", 2, ~std::uint64_t{0} - 1)), "accepted");
  EXPECT_EQ(fault_of(altered("other", 2, ~std::uint64_t{0})), "items: number out of range");
}

TEST(WireParse, ItemsHaveAPayload) {
  Bytes message = sample("other");
  message.resize(kHeaderBytes + kItemsHeadBytes);
  reseal(message);
  EXPECT_EQ(fault_of(message), "items: no payload");
  message.push_back(0);
  reseal(message);
  EXPECT_EQ(fault_of(message), "accepted");
}

TEST(WireParse, ThePayloadOfItemsIsAsLongAsTheLimitOfABody) {
  const Items items{4, 0, Bytes(kMaxItemsBytes - kItemsHeadBytes, 1)};
  EXPECT_EQ(fault_of(encode(items)), "accepted");
}

TEST(WireParse, FrameFieldsAreChecked) {
  EXPECT_EQ(fault_of(altered("frame", 24, std::uint8_t{2})), "frame: unknown image encoding 2");
  EXPECT_EQ(fault_of(altered("frame", 27, std::uint8_t{1})), "frame: reserved bytes are not zero");
  EXPECT_EQ(fault_of(altered("frame", 0, ~std::uint64_t{0})),
            "frame: sequence number out of range");
}

TEST(WireParse, AQualityIsAtMost100) {
  const auto with_quality = [](std::uint8_t quality) {
    return fault_of(altered("frame", 25, quality));
  };
  EXPECT_EQ(with_quality(0), "accepted");
  EXPECT_EQ(with_quality(100), "accepted");
  EXPECT_EQ(with_quality(101), "frame: quality 101");
  EXPECT_EQ(with_quality(255), "frame: quality 255");
}

TEST(WireParse, AReducedFrameIsSmallerThanTheWholeOne) {
  const auto reduced_from = [](std::uint32_t bytes) {
    return fault_of(altered("frame", 32, bytes));
  };
  EXPECT_EQ(reduced_from(1), "frame: reduced from 1 bytes to 11");
  EXPECT_EQ(reduced_from(11), "frame: reduced from 11 bytes to 11");
  EXPECT_EQ(reduced_from(12), "accepted");
  EXPECT_EQ(reduced_from(0xFFFFFFFF), "accepted");
}

TEST(WireParse, AWholeFrameHasNoChecksumOfAnother) {
  EXPECT_EQ(fault_of(altered("frame", 32, std::uint32_t{0})), "frame: reduced from 0 bytes to 11");
  EXPECT_EQ(fault_of(altered("frame", 32, std::uint64_t{0})), "accepted");
}

TEST(WireParse, ALateFrameIsWhole) {
  EXPECT_EQ(parse_late_record(encode_late_record("s1", reduced_frame())).error().text,
            "late frame: it is not whole");
}

TEST(WireParse, LateItemsAreOfAStreamThatTheRobotDeclares) {
  const Items items{kFirstOther, 7, {1, 2, 3}};
  const auto late = parse_late_record(encode_late_record("s1", items));
  ASSERT_TRUE(late) << late.error().text;
  EXPECT_EQ(late.value().session_id, "s1");
  EXPECT_EQ(late.value().items, items);
  EXPECT_FALSE(parse_late_record(encode_late_record("s1", Items{kAccounts, 7, {1}})));
}

TEST(WireParse, TheLeftImageIsAtLeastAByteAndAtMostAll) {
  const auto with_left_bytes = [](std::uint32_t bytes) {
    return fault_of(altered("frame", 28, bytes));
  };
  EXPECT_EQ(with_left_bytes(0), "frame: left image of 0 bytes, of 11");
  EXPECT_EQ(with_left_bytes(1), "accepted");
  EXPECT_EQ(with_left_bytes(11), "accepted");
  EXPECT_EQ(with_left_bytes(12), "frame: left image of 12 bytes, of 11");
  EXPECT_EQ(with_left_bytes(0xFFFFFFFF), "frame: left image of 4294967295 bytes, of 11");
}

TEST(WireParse, WelcomeReservedBytesAreChecked) {
  EXPECT_EQ(fault_of(altered("welcome", 3, std::uint8_t{1})),
            "welcome: reserved bytes are not zero");
}

TEST(WireParse, WelcomeReservedBitsAreChecked) {
  EXPECT_EQ(fault_of(altered("welcome", 1, std::uint8_t{0})), "accepted");
  EXPECT_EQ(fault_of(altered("welcome", 1, std::uint8_t{2})),
            "welcome: reserved bits are not zero");
}

TEST(WireParse, AWelcomeTakesFramesAndDropRecords) {
  const auto taking = [](const std::vector<StreamId>& streams) {
    Welcome welcome;
    for (const StreamId id : streams) welcome.takes.set(id);
    return fault_of(encode(welcome));
  };
  EXPECT_EQ(taking({0, 1}), "accepted");
  EXPECT_EQ(taking({0, 1, 2, 3, 31}), "accepted");
  for (const auto& streams : std::vector<std::vector<StreamId>>{{}, {0}, {1}, {0, 2}, {1, 2}}) {
    EXPECT_EQ(taking(streams), "welcome: without frames or drop records");
  }
}

TEST(WireParse, APositionHasItsStreamsInOrder) {
  const auto with_second = [](StreamId id) { return fault_of(altered("ack", 12, id)); };
  EXPECT_EQ(with_second(0), "ack: stream 0, not 1 to 31");  // the first is 0
  EXPECT_EQ(with_second(1), "accepted");
  EXPECT_EQ(with_second(30), "accepted");
  EXPECT_EQ(with_second(31), "ack: stream 31, not 32 to 31");  // the third is that
  EXPECT_EQ(with_second(32), "ack: stream 32, not 1 to 31");
}

TEST(WireParse, APositionHasAsManyStreamsAsItSays) {
  EXPECT_EQ(fault_of(altered("bye", 0, std::uint16_t{1})), "bye has 10 bytes too many");
  EXPECT_EQ(fault_of(altered("bye", 0, std::uint16_t{3})), "bye ends too early");
  EXPECT_EQ(fault_of(altered("bye", 0, std::uint16_t{0xFFFF})), "bye ends too early");
}

TEST(WireParse, ALatePartIsWithinItsRecord) {
  const auto with = [](std::size_t offset, std::uint32_t value) {
    return fault_of(altered("late", kItemsHeadBytes + offset, value));
  };
  EXPECT_EQ(with(0, 2), "accepted");
  EXPECT_EQ(with(0, 4), "late frame: 4 bytes from 4 on are no part of 7");
  EXPECT_EQ(with(0, 0xFFFFFFFF), "late frame: 4 bytes from 4294967295 on are no part of 7");
  EXPECT_EQ(with(4, 6), "late frame: 4 bytes from 3 on are no part of 6");
}

TEST(WireParse, ALatePartPointsIntoItsPayload) {
  const Bytes payload = encode_late_part({3, 7, as_bytes("late")});
  EXPECT_EQ(parse_late_part(payload).value().bytes.data(), &payload[8]);
}

TEST(WireParse, AccountFieldsAreChecked) {
  const auto with = [](std::size_t offset, auto value) {
    return fault_of(altered("account", kItemsHeadBytes + offset, value));
  };
  constexpr std::uint64_t kCaptured = 0x0102030405060708;  // of the sample, which has "s1"
  const auto beyond = [](const std::string& frame) {
    return "account: frame " + frame + " is beyond the 72623859790382856 captured";
  };
  EXPECT_EQ(with(2, '/'), "account: session id \"/1\" is not valid");
  EXPECT_EQ(with(4, std::uint8_t{0}), "accepted");
  EXPECT_EQ(with(4, std::uint8_t{4}), "account: reserved bits are not zero");
  EXPECT_EQ(with(5, ~std::uint64_t{0}), "account: sequence number out of range");
  EXPECT_EQ(with(5, ~std::uint64_t{0} - 1), "accepted");
  EXPECT_EQ(with(5, std::uint64_t{15}), "accepted");
  EXPECT_EQ(with(5, std::uint64_t{14}), "account: frame 14 is beyond the 14 captured");
  EXPECT_EQ(with(21, kCaptured), "accepted");
  EXPECT_EQ(with(21, kCaptured + 1), beyond("72623859790382856"));
  EXPECT_EQ(with(29, kCaptured - 3), "accepted");  // from 3 on
  EXPECT_EQ(with(29, kCaptured - 2), beyond("72623859790382856"));
  EXPECT_EQ(with(29, ~std::uint64_t{0}), beyond("18446744073709551614"));
  EXPECT_EQ(with(37, kCaptured - 5), "accepted");  // 5 of them
  EXPECT_EQ(with(37, ~std::uint64_t{0}), beyond("18446744073709551614"));
  EXPECT_EQ(with(47, std::uint16_t{2}), "account: 105 bytes are not 2 records");
  EXPECT_EQ(with(47, std::uint16_t{1025}), "account: 1025 records, not 0 to 1024");
}

TEST(WireParse, AnAccountMayBeOfNothing) {
  Account nothing;
  nothing.session_id = "s1";
  EXPECT_EQ(parse_account(encode_account(nothing)).value(), nothing);
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
  EXPECT_EQ(fault_of(altered("ack", 32, std::uint64_t{7})), "accepted");
  EXPECT_EQ(fault_of(altered("ack", 32, std::uint64_t{6})), "ack: received is below the position");
}

TEST(WireParse, UnknownErrorCodeCountsAsRefused) {
  for (const std::uint16_t code : std::initializer_list<std::uint16_t>{0, 9, 0xFFFF}) {
    const Bytes message = altered("error", 0, code);
    const auto body = std::span(message).subspan(kHeaderBytes);
    const auto error = parse_error(header_of(message).value(), body);
    EXPECT_EQ(error.value(), (ErrorMessage{ErrorCode::kRefused, "no version in common"}));
  }
}

TEST(WireParse, SentAwayIsAnError) {
  const ErrorMessage away{ErrorCode::kSentAway, "the disk is full"};
  const Bytes message = encode(away);
  EXPECT_EQ(message[kHeaderBytes + 1], 8);
  const auto again =
      parse_error(header_of(message).value(), std::span(message).subspan(kHeaderBytes));
  ASSERT_TRUE(again) << again.error().text;
  EXPECT_EQ(again.value(), away);
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
  const auto sample_count = static_cast<int>(samples.size());
  std::mt19937 random(20201024);
  for (int i = 0; i < 100'000; ++i) {
    const Bytes& original = std::next(samples.begin(), i % sample_count)->second;
    Bytes message = original;
    damage(message, random);
    const auto again = there_and_back(message);
    ASSERT_TRUE(!again || again.value() == original) << i << ": " << hex(message);
  }
}

TEST(WireParse, DamageUnderFittingChecksumsIsRefusedOrReadInOneWayOnly) {
  const auto samples = sample_messages();
  const auto sample_count = static_cast<int>(samples.size());
  std::mt19937 random(14861);
  int accepted = 0;
  for (int i = 0; i < 100'000; ++i) {
    Bytes message = std::next(samples.begin(), i % sample_count)->second;
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
