// SPDX-License-Identifier: Apache-2.0
#include "server/http/request_reader.hpp"

#include <gtest/gtest.h>

#include <string_view>

#include "common/as_bytes.hpp"

namespace orbbuf {
namespace {

unsigned fault_of(std::string_view text) {
  RequestReader reader;
  reader.add(as_bytes(text));
  EXPECT_FALSE(reader.next());
  return reader.fault();
}

TEST(RequestReader, ReadsARequest) {
  RequestReader reader;
  reader.add(as_bytes("GET /api/robots?since=7 HTTP/1.1\r\nHost: a:1\r\nAccept: */*\r\n\r\n"));
  const auto request = reader.next();
  ASSERT_TRUE(request);
  EXPECT_TRUE(request->is_get);
  EXPECT_FALSE(request->is_head);
  EXPECT_TRUE(request->keeps_alive);
  EXPECT_EQ(request->path, "/api/robots");
  EXPECT_EQ(request->query, "since=7");
  EXPECT_EQ(request->host, "a:1");
  EXPECT_TRUE(reader.is_between_requests());
}

TEST(RequestReader, ReadsItByteByByteAndTheNextBehindIt) {
  const std::string_view two = "HEAD / HTTP/1.1\r\nHost: a\r\n\r\nGET /b HTTP/1.0\r\n\r\n";
  RequestReader reader;
  std::string paths;
  for (const char byte : two) {
    reader.add(as_bytes({&byte, 1}));
    if (const auto request = reader.next()) paths += request->path + (request->is_head ? "H" : "");
  }
  EXPECT_EQ(paths, "/H/b");
  EXPECT_EQ(reader.fault(), 0U);
}

TEST(RequestReader, ReadsRequestsThatComeAtOnceOneByOne) {
  RequestReader reader;
  reader.add(as_bytes("GET /a HTTP/1.1\r\n\r\nGET /b HTTP/1.1\r\nConnection: close\r\n\r\n"));
  EXPECT_EQ(reader.next()->path, "/a");
  EXPECT_FALSE(reader.is_between_requests());
  const auto second = reader.next();
  EXPECT_EQ(second->path, "/b");
  EXPECT_FALSE(second->keeps_alive);
  EXPECT_FALSE(reader.next());
}

TEST(RequestReader, OtherMethodsAreSaidToBeOthers) {
  RequestReader reader;
  reader.add(as_bytes("DELETE / HTTP/1.1\r\n\r\n"));
  EXPECT_FALSE(reader.next()->is_get);
}

TEST(RequestReader, NonsenseIsABadRequest) {
  for (const char* text : {"\r\n\r\n\r\n\r\nx", "ORBB\1\1", "GET\r\n\r\n", "GET / HTTP/9.9\r\n\r\n",
                           "GET / HTTP/1.1\r\nno colon\r\n\r\n", "GET x HTTP/1.1\r\n\r\n",
                           "GET / HTTP/1.1\r\nContent-Length: -1\r\n\r\n", "\x16\x03\x01\x02"}) {
    EXPECT_EQ(fault_of(text), 400U) << text;
  }
}

TEST(RequestReader, BodiesAreRefused) {
  EXPECT_EQ(fault_of("POST / HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc"), 413U);
  EXPECT_EQ(fault_of("POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n\r\n"),
            413U);
}

TEST(RequestReader, LongFieldsAreRefusedWhetherTheyEndOrNot) {
  const std::string fields(RequestReader::kMaxBytes, 'a');
  EXPECT_EQ(fault_of("GET / HTTP/1.1\r\nX: " + fields), 431U);
  EXPECT_EQ(fault_of("GET / HTTP/1.1\r\nX: " + fields + "\r\n\r\n"), 431U);
  EXPECT_EQ(fault_of("GET /" + fields), 431U);
}

}  // namespace
}  // namespace orbbuf
