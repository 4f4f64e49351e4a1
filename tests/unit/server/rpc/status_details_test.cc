#include "server/rpc/status_details.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "maneuver/v1/status.pb.h"

namespace maneuver::rpc::status_details_test {
namespace {

// What gRPC's clients take of all headers of an answer, by default.
constexpr size_t kHeaderLimit = 8192;

// As they go over the wire: percent-encoded, and in base 64.
size_t BytesOf(const grpc::Status& status) {
  size_t bytes = (status.error_details().size() + 2) / 3 * 4;
  for (const char c : status.error_message()) bytes += c >= ' ' && c <= '~' && c != '%' ? 1 : 3;
  return bytes;
}

v1::Status Details(const grpc::Status& status) {
  v1::Status details;
  EXPECT_TRUE(details.ParseFromString(status.error_details()));
  return details;
}

v1::BadRequest Violations(const grpc::Status& status) {
  v1::BadRequest violations;
  const v1::Status details = Details(status);
  for (const auto& any : details.details()) {
    if (any.type_url() == "type.googleapis.com/google.rpc.BadRequest") {
      violations.ParseFromString(any.value());
    }
  }
  return violations;
}

TEST(StatusDetailsTest, AnErrorFitsIntoTheHeadersThatClientsAccept) {
  std::vector<scene::FieldViolation> violations;
  for (int i = 0; i < 16; ++i) {
    violations.push_back({std::string(3000, 'f'), "\xe2\x82\xac" + std::string(5000, 'd')});
  }
  const grpc::Status status = ToGrpcStatus(errors::InvalidFields(violations));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_LE(BytesOf(status), kHeaderLimit - 1024);  // the others need some as well
  EXPECT_EQ(errors::ReasonOf(errors::FromProto(Details(status))), "INVALID_FIELD");
  EXPECT_GE(Violations(status).field_violations_size(), 1);
}

TEST(StatusDetailsTest, CutsALongMessageBetweenCharacters) {
  std::string message = "a";
  for (int i = 0; i < 10'000; ++i) message += "\xe2\x82\xac";  // a euro sign, three bytes
  const grpc::Status status = ToGrpcStatus(absl::NotFoundError(message));
  EXPECT_LE(BytesOf(status), kHeaderLimit - 1024);
  const std::string& cut = status.error_message();
  ASSERT_THAT(cut, testing::EndsWith("..."));
  EXPECT_EQ((cut.size() - 3) % 3, 1u);
}

TEST(StatusDetailsTest, KeepsAnErrorOfUsualSizeWhole) {
  std::vector<scene::FieldViolation> violations;
  for (int i = 0; i < 16; ++i) {
    violations.push_back({"settings.model.mlp.hidden[3]", "width must be 1 to 4096, not -5"});
  }
  const absl::Status error = errors::InvalidFields(violations);
  const grpc::Status status = ToGrpcStatus(error);
  EXPECT_EQ(status.error_message(), std::string(error.message()));
  EXPECT_EQ(Violations(status).field_violations_size(), 16);
}

}  // namespace
}  // namespace maneuver::rpc::status_details_test
