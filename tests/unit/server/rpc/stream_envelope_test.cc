#include "server/rpc/stream_envelope.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::rpc {
namespace {

// In slices of so many bytes, as a network delivers them.
grpc::ByteBuffer InSlices(const std::string& bytes, size_t size) {
  std::vector<grpc::Slice> slices;
  for (size_t i = 0; i < bytes.size(); i += size) slices.emplace_back(bytes.substr(i, size));
  return {slices.data(), slices.size()};
}

v1::StreamPredictRequest Request() {
  v1::StreamPredictRequest request;
  request.set_request_id("cycle 7");
  request.mutable_timeout()->set_seconds(1);
  request.mutable_timeout()->set_nanos(500);
  for (int i = 0; i < 10; ++i) request.mutable_request()->add_scenarios()->set_map_id("a map");
  return request;
}

TEST(StreamEnvelopeTest, HasTheIdAndTheTimeoutHoweverTheMessageComes) {
  const std::string bytes = Request().SerializeAsString();
  for (const size_t size : {size_t{1}, size_t{7}, bytes.size()}) {
    const grpc::ByteBuffer message = InSlices(bytes, size);
    const auto envelope = ReadEnvelope(message);
    ASSERT_TRUE(envelope.has_value());
    EXPECT_EQ(envelope->request_id, "cycle 7");
    ASSERT_TRUE(envelope->timeout.has_value());
    EXPECT_EQ(envelope->timeout->seconds(), 1);
    EXPECT_EQ(envelope->timeout->nanos(), 500);
    EXPECT_EQ(message.Length(), bytes.size());  // and nothing is taken away
  }
}

TEST(StreamEnvelopeTest, WhatIsNotSetIsNotThere) {
  const auto envelope = ReadEnvelope(InSlices("", 1));
  ASSERT_TRUE(envelope.has_value());
  EXPECT_EQ(envelope->request_id, "");
  EXPECT_FALSE(envelope->timeout.has_value());
}

TEST(StreamEnvelopeTest, TheScenesAreNotParsed) {
  // Field 2, three bytes that are no message; then field 1.
  const auto envelope = ReadEnvelope(InSlices(std::string("\x12\x03\xff\xff\xff\x0a\x01z"), 2));
  ASSERT_TRUE(envelope.has_value());
  EXPECT_EQ(envelope->request_id, "z");
}

TEST(StreamEnvelopeTest, AMessageThatIsCutOffIsNone) {
  const std::string bytes = Request().SerializeAsString();
  EXPECT_FALSE(ReadEnvelope(InSlices(bytes.substr(0, bytes.size() - 1), 5)).has_value());
  EXPECT_FALSE(ReadEnvelope(InSlices(std::string(3, '\0'), 1)).has_value());
  EXPECT_FALSE(ReadEnvelope(InSlices("\xff\xff\xff", 3)).has_value());
}

}  // namespace
}  // namespace maneuver::rpc
