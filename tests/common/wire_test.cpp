// SPDX-License-Identifier: Apache-2.0
#include "common/wire.hpp"

#include <gtest/gtest.h>

#include "tests/common/wire_samples.hpp"

namespace orbbuf::wire {
namespace {

using namespace std::string_literals;

/// The body of an encoded message, as an announced one.
Parsed<Hello> parse_back(const Hello& hello) {
  const Bytes message = encode(hello);
  return parse_hello(header_of(message).value(), std::span(message).subspan(kHeaderBytes));
}

Hello hello_with(std::string software, std::string calibration) {
  return {5, 5, "robot", "session", std::move(software), std::move(calibration)};
}

TEST(Wire, EachMessageHasItsGoldenBytes) {
  // Made by Python's struct and zlib from docs/protocol.md, not by the code under test.
  const std::map<Type, std::string> golden = {
      {Type::kHello,
       "4f5242420101000000000037bd70d7357d3f065f"
       "0505000000067462332d303700103230323031303234543130313530305a000d"
       "6f72626275666420302e312e300008302e3509302e350a"},
      {Type::kWelcome,
       "4f5242420102000000000018e137c3ad83383ff7"
       "050000000000000001020304050607081112131415161718"},
      {Type::kFrame,
       "4f5242420103000000000033e7ebca9345fccb48"
       "0102030405060708fffffffffffffffe1112131404ca0172011e000000000005"
       "0102030411121314ffd801ffd9ffd80202ffd9"},
      {Type::kAck,
       "4f5242420104000000000018c302320a060353cd"
       "000000000000000700000000000000030000000000000009"},
      {Type::kDropped,
       "4f5242420105000000000056c0c5c2ae631cc342"
       "00000000000000050004000000000000000affffffffffffffff010101000000"
       "000000000b000000000000000002ffff000000000000000c0000000000000001"
       "03ffff000000000000000d000000000000000204ffff"},
      {Type::kStats,
       "4f52424201060000000000600eeab5e9f9da4b8f"
       "0000000000000015000000000000000100000000000000020000000000000003"
       "0000000000000004000000000000000500000000000000060000001900000000"
       "0001388000000000000f424000009c40fffffffffffffffe0000000000000007"},
      {Type::kBye,
       "4f5242420107000000000010500e2d5448f7bb4e"
       "00000000000000080000000000000004"},
      {Type::kError,
       "4f5242420108000000000018dcc22456eb89b88b"
       "000200146e6f2076657273696f6e20696e20636f6d6d6f6e"},
      {Type::kLate,
       "4f5242420109000000000014b765bd8969084fbb"
       "000000000000000700000003000000076c617465"},
      {Type::kLateAck,
       "4f524242010a0000000000086bf9575b013dbc12"
       "0000000000000008"},
      {Type::kSpool,
       "4f524242010b00000000002a3a634d2c86cb5413"
       "0002000273310000000000000019000000000000000300027332000000000000"
       "00010000000000000000"},
  };
  for (const auto& [type, message] : sample_messages()) {
    EXPECT_EQ(hex(message), golden.at(type)) << to_string(type);
  }
}

TEST(Wire, AWelcomeSaysWhetherLateFramesAreTaken) {
  const Bytes message = encode(Welcome{5, {7, 3}, 16U << 20, true});
  EXPECT_EQ(hex(message),
            "4f5242420102000000000018489edcb9b272d574"
            "050100000100000000000000000000070000000000000003");
  EXPECT_EQ(there_and_back(message).value(), message);
}

TEST(Wire, AWelcomeSaysWhetherThereIsAHeartbeat) {
  for (const bool takes_late : {false, true}) {
    const Bytes message = encode(Welcome{5, {7, 3}, 16U << 20, takes_late, true});
    EXPECT_EQ(message.at(kHeaderBytes + 1), takes_late ? 3 : 2);
    EXPECT_EQ(there_and_back(message).value(), message);
  }
}

TEST(Wire, ALateRecordIsTheSessionAndTheFramesBody) {
  const EncodedFrame sent = sample_frame();
  const Bytes record = encode_late_record("s1", sent);
  const Bytes message = encode_whole(sent);
  EXPECT_EQ(hex(record), "00027331" + hex(std::span(message).subspan(12, 4)) +
                             hex(std::span(message).subspan(kHeaderBytes)));
  const auto late = parse_late_record(record);
  ASSERT_TRUE(late) << late.error().text;
  EXPECT_EQ(late.value().session_id, "s1");
  EXPECT_EQ(encode_whole(late.value().frame), message);
  EXPECT_LE(record.size(), kMaxLateHeadBytes + sent.jpeg.size());
}

TEST(Wire, AMonoFrameIsALeftImageAlone) {
  const Bytes message = encode_whole(mono_frame());
  EXPECT_EQ(hex(message),
            "4f524242010300000000002d56576ff0f46db46e"
            "0102030405060708fffffffffffffffe1112131404ca01720100000000000005"
            "0000000000000000ffd800ffd9");
  EXPECT_EQ(there_and_back(message).value(), message);
}

TEST(Wire, EachMessageSurvivesThereAndBack) {
  for (const auto& [type, message] : sample_messages()) {
    const auto again = there_and_back(message);
    ASSERT_TRUE(again) << to_string(type) << ": " << again.error().text;
    EXPECT_EQ(again.value(), message) << to_string(type);
  }
}

TEST(Wire, FieldsComeBackAsTheyWere) {
  const Hello hello{5, 7, "tb3", "s-1", "orbbufd 0.1.0", "fx fy\r\n\tcx"};
  EXPECT_EQ(parse_back(hello).value(), hello);

  const EncodedFrame sent = reduced_frame();
  const auto message = encode_whole(sent);
  const auto body = std::span(message).subspan(kHeaderBytes);
  const auto got =
      parse_frame(header_of(message).value(), body.first<kFrameMetaBytes>(), Bytes(sent.jpeg));
  EXPECT_EQ(got.value().sequence, sent.sequence);
  EXPECT_EQ(got.value().capture_time_ns, sent.capture_time_ns);
  EXPECT_EQ(got.value().exposure_ns, sent.exposure_ns);
  EXPECT_EQ(got.value().width_px, sent.width_px);
  EXPECT_EQ(got.value().height_px, sent.height_px);
  EXPECT_EQ(got.value().jpeg_crc, sent.jpeg_crc);
  EXPECT_EQ(got.value().jpeg, sent.jpeg);
  EXPECT_EQ(got.value().quality, sent.quality);
  EXPECT_EQ(got.value().whole_bytes, sent.whole_bytes);
  EXPECT_EQ(got.value().whole_crc, sent.whole_crc);
  EXPECT_EQ(hex(got.value().left()), "ffd801ffd9");
  EXPECT_EQ(hex(got.value().right()), "ffd80202ffd9");
}

TEST(Wire, FrameHeadHoldsTheChecksumOfTheWholeBody) {
  for (const std::size_t size : {1U, 2U, 77'000U, 1'000'000U}) {
    EncodedFrame frame = sample_frame();
    frame.jpeg.assign(size, 0xA5);
    frame.jpeg_crc = crc32(frame.jpeg);
    const Bytes message = encode_whole(frame);
    EXPECT_EQ(header_of(message).value().body_crc, crc32(std::span(message).subspan(kHeaderBytes)));
    EXPECT_TRUE(there_and_back(message)) << size;
  }
}

TEST(Wire, Crc32IsThatOfZlib) {
  const Bytes check = bytes_of("123456789");
  EXPECT_EQ(crc32(check), 0xCBF43926U);
  EXPECT_EQ(crc32({}), 0U);
}

TEST(Wire, Crc32ContinuesFromItsSeed) {
  const Bytes check = bytes_of("123456789");
  for (std::size_t i = 0; i <= check.size(); ++i) {
    const std::uint32_t begin = crc32(std::span(check).first(i));
    EXPECT_EQ(crc32(std::span(check).subspan(i), begin), 0xCBF43926U) << i;
  }
}

TEST(Wire, TextOverItsLimitIsCut) {
  const auto hello = parse_back(
      hello_with(std::string(kMaxTextBytes + 1, 's'), std::string(kMaxCalibrationBytes + 1, 'c')));
  EXPECT_EQ(hello.value().software, std::string(kMaxTextBytes, 's'));
  EXPECT_EQ(hello.value().calibration, std::string(kMaxCalibrationBytes, 'c'));
}

TEST(Wire, TextIsNotCutThroughACharacter) {
  const std::string begin(kMaxTextBytes - 2, 'x');
  EXPECT_EQ(parse_back(hello_with(begin + "\u20AC", "")).value().software, begin);
  EXPECT_EQ(parse_back(hello_with(begin + "\u00E4\u00E4", "")).value().software, begin + "\u00E4");
}

TEST(Wire, ControlCharactersInTextsAreMadeVisible) {
  const auto hello = parse_back(hello_with("a\nb\x1B[2Jc\x7F\0d\u0085\u009Be\u00E4"s, ""));
  EXPECT_EQ(hello.value().software, "a?b?[2Jc??d??e\u00E4");
}

TEST(Wire, CalibrationKeepsItsLines) {
  const auto hello = parse_back(hello_with("", "0.5\t0.5\r\n640 480\n\x1B\x07"));
  EXPECT_EQ(hello.value().calibration, "0.5\t0.5\r\n640 480\n??");
}

TEST(Wire, IdsAreSafeAsFileNames) {
  for (const auto* id : {"a", "tb3-07", "2020.10_24", "_", "0"}) EXPECT_TRUE(is_valid_id(id)) << id;
  for (const auto* id :
       {"", ".", "..", ".x", "-rf", "a/b", "a b", "a\n", "\u00E4", "a:b", "a\\b"}) {
    EXPECT_FALSE(is_valid_id(id)) << id;
  }
  EXPECT_FALSE(is_valid_id(std::string_view("a\0b", 3)));
}

TEST(Wire, IdsEndAtTheirLimit) {
  EXPECT_TRUE(is_valid_id(std::string(kMaxIdBytes, 'a')));
  EXPECT_FALSE(is_valid_id(std::string(kMaxIdBytes + 1, 'a')));
}

TEST(Wire, TypesHaveNames) {
  std::string names;
  for (const auto& [type, message] : sample_messages()) names.append(to_string(type)).append(" ");
  EXPECT_EQ(names, "hello welcome frame ack dropped stats bye error late late ack spool ");
}

}  // namespace
}  // namespace orbbuf::wire
