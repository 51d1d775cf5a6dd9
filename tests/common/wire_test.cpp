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
  return {6, 6, "robot", "session", std::move(software), std::move(calibration), {}};
}

TEST(Wire, EachMessageHasItsGoldenBytes) {
  // Made by Python's struct and zlib from docs/protocol.md, not by the code under test.
  const std::map<std::string, std::string> golden = {
      {"hello",
       "4f5242420101000000000056b04a263c76808861"
       "0607000000067462332d303700103230323031303234543130313530305a000d"
       "6f72626275666420302e312e300008302e3509302e350a000200040003696d75"
       "000a6f72626275662f696d75001f00047363616e0000"},
      {"welcome",
       "4f524242010200000000003c4101e1a003f70c89"
       "0601000001000000000500000102030405060708000111121314151617180002"
       "00000000000000000003000000000000000000040000000000000009"},
      {"frame",
       "4f5242420103000000000033e7ebca9345fccb48"
       "0102030405060708fffffffffffffffe1112131404ca0172011e000000000005"
       "0102030411121314ffd801ffd9ffd80202ffd9"},
      {"ack",
       "4f524242010400000000002883328f95298608c6"
       "00030000000000000000000700010000000000000003001f0000000000000002"
       "0000000000000009"},
      {"drops",
       "4f5242420105000000000075538f54ab60f409d9"
       "000100000000000000050003000000000000000a0000000000000001ffffffff"
       "ffffffff0000000000000000010101000000000000000b000000000000000300"
       "00000000000000000000000000000202ffff000000000000000e000000000000"
       "00010000000000000003000000000000000007ffff"},
      {"late",
       "4f5242420105000000000016f45d9699d1cc20ea"
       "0002000000000000000700000003000000076c617465"},
      {"account",
       "4f52424201050000000000a40cef678120082702"
       "0003000000000000000000027331030102030405060708fffffffffffffffe00"
       "0000000000000700000000000000050000000000000003000000030000000000"
       "00000a0000000000000001ffffffffffffffff00000000000000000101010000"
       "00000000000b00000000000000030000000000000000000000000000000202ff"
       "ff000000000000000e0000000000000001000000000000000300000000000000"
       "0007ffff"},
      {"other",
       "4f5242420105000000000014f6e402a1f6a5891e"
       "0004010203040506070800016f6e65206974656d"},
      {"stats",
       "4f524242010600000000006c8d895d9546438ed1"
       "0000000000000015000000000000000100000000000000020000000000000003"
       "0000000000000004000000000000000500000000000000060000001900000000"
       "0001388000000000000f424000009c40fffffffffffffffe0000000000000007"
       "000100040000000000000009"},
      {"bye",
       "4f5242420107000000000016e6388182b24a428e"
       "00020000000000000000000800010000000000000004"},
      {"error",
       "4f5242420108000000000018dcc22456eb89b88b"
       "000200146e6f2076657273696f6e20696e20636f6d6d6f6e"},
  };
  for (const auto& [name, message] : sample_messages()) {
    EXPECT_EQ(hex(message), golden.at(name)) << name;
  }
}

TEST(Wire, AWelcomeNamesTheStreamsThatTheServerTakes) {
  Welcome welcome;
  welcome.position = {7, 0};
  welcome.position[4] = 9;  // of a stream that it does not take
  welcome.takes.set(kFrames).set(kDrops);
  const Bytes message = encode(welcome);
  EXPECT_EQ(hex(message),
            "4f524242010200000000001e53c2743823eda2c9"
            "060000000000000000020000000000000000000700010000000000000000");
  const auto again =
      parse_welcome(header_of(message).value(), std::span(message).subspan(kHeaderBytes));
  EXPECT_EQ(again.value().takes, welcome.takes);
  EXPECT_EQ(again.value().position, (Position{7, 0}));
}

TEST(Wire, AnAckSaysWhyTheServerTakesNothing) {
  const Ack paused{{3, 1}, 3, "write x: No space left on device"};
  const Bytes message = encode(paused);
  EXPECT_EQ(message.size(), encode(Ack{{3, 1}, 3}).size() + 2 + paused.pause.size());
  const auto again =
      parse_ack(header_of(message).value(), std::span(message).subspan(kHeaderBytes));
  EXPECT_EQ(again.value(), paused);
}

TEST(Wire, APositionNamesTheStreamsOfWhichThereIsSomething) {
  EXPECT_EQ(encode(Bye{}).size(), kHeaderBytes + 2);
  Bye all;
  for (StreamId id = 0; id < kMostStreams; ++id) all.position[id] = ~std::uint64_t{0} - id;
  const Bytes message = encode(all);
  EXPECT_EQ(message.size(), kHeaderBytes + 2 + kMostStreams * 10);
  const auto again =
      parse_bye(header_of(message).value(), std::span(message).subspan(kHeaderBytes));
  EXPECT_EQ(again.value(), all);
}

TEST(Wire, AnAccountSpeaksOfNoFrameBeyondItsEnd) {
  const auto written = [](const Account& account) {
    return parse_account(encode_account(account)).value().captured;
  };
  Account account;
  account.session_id = "s1";
  account.captured = 9;
  EXPECT_EQ(written(account), 9U);
  account.confirmed = 10;
  EXPECT_EQ(written(account), 10U);
  account.first_held = 10;  // of none
  EXPECT_EQ(written(account), 10U);
  account.held = 2;
  EXPECT_EQ(written(account), 12U);
  account.given_up = {{11, 0, DropReason::kBusy, kUnknownSimilarity, 3, 1}, {4}};
  EXPECT_EQ(written(account), 14U);
}

TEST(Wire, ALateRecordIsTheSessionAndTheFramesBody) {
  const EncodedFrame sent = sample_frame();
  const Bytes record = encode_late_record("s1", sent);
  const Bytes message = encode_whole(sent);
  EXPECT_EQ(hex(record), "0002733103" + hex(std::span(message).subspan(12, 4)) +
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
  for (const auto& [name, message] : sample_messages()) {
    const auto again = there_and_back(message);
    ASSERT_TRUE(again) << name << ": " << again.error().text;
    EXPECT_EQ(again.value(), message) << name;
  }
}

TEST(Wire, FieldsComeBackAsTheyWere) {
  const Hello hello{6,
                    7,
                    "tb3",
                    "s-1",
                    "orbbufd 0.1.0",
                    "fx fy\r\n\tcx",
                    {{4, "imu", "orbbuf/imu"}, {9, "scan", ""}}};
  EXPECT_EQ(parse_back(hello).value(), hello);

  EXPECT_EQ(parse_drops(encode_drops(sample_drops())).value(), sample_drops());
  EXPECT_EQ(parse_account(encode_account(sample_account())).value(), sample_account());

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

TEST(Wire, NamesOfStreamsOverTheirLimitAreCut) {
  Hello hello = hello_with("", "");
  hello.streams = {{4, std::string(kMaxNameBytes + 1, 'n'), std::string(kMaxNameBytes + 1, 'c')}};
  const StreamDeclaration cut{4, std::string(kMaxNameBytes, 'n'), std::string(kMaxNameBytes, 'c')};
  EXPECT_EQ(parse_back(hello).value().streams, std::vector<StreamDeclaration>{cut});
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
  for (int type = 0; type <= 9; ++type) {
    names.append(to_string(static_cast<Type>(type))).append(" ");
  }
  EXPECT_EQ(names, "unknown hello welcome frame ack items stats bye error unknown ");
}

}  // namespace
}  // namespace orbbuf::wire
