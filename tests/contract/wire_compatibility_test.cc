// Error details must be readable by every client that knows google.rpc: the same field numbers and
// types as its Status, ErrorInfo, BadRequest and RetryInfo.

#include <gtest/gtest.h>

#include <string>

#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/status.pb.h"

namespace maneuver {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;

// Field `number` of a message, as "name:type", with "*" if it repeats.
std::string Field(const Descriptor* message, int number) {
  const FieldDescriptor* field = message->FindFieldByNumber(number);
  if (field == nullptr) return "none";
  return field->name() + ":" + field->type_name() + (field->is_repeated() ? "*" : "");
}

TEST(WireCompatibilityTest, StatusIsGoogleRpcStatus) {
  const Descriptor* status = v1::Status::descriptor();
  EXPECT_EQ(status->field_count(), 3);
  EXPECT_EQ(Field(status, 1), "code:int32");
  EXPECT_EQ(Field(status, 2), "message:string");
  EXPECT_EQ(Field(status, 3), "details:message*");
  EXPECT_EQ(status->FindFieldByNumber(3)->message_type()->full_name(), "google.protobuf.Any");
}

TEST(WireCompatibilityTest, ErrorInfoIsGoogleRpcErrorInfo) {
  const Descriptor* info = v1::ErrorInfo::descriptor();
  EXPECT_EQ(info->field_count(), 3);
  EXPECT_EQ(Field(info, 1), "reason:string");
  EXPECT_EQ(Field(info, 2), "domain:string");
  EXPECT_EQ(Field(info, 3), "metadata:message*");
  EXPECT_TRUE(info->FindFieldByNumber(3)->is_map());
}

TEST(WireCompatibilityTest, BadRequestIsGoogleRpcBadRequest) {
  const Descriptor* request = v1::BadRequest::descriptor();
  EXPECT_EQ(request->field_count(), 1);
  EXPECT_EQ(Field(request, 1), "field_violations:message*");
  const Descriptor* violation = v1::BadRequest::FieldViolation::descriptor();
  EXPECT_EQ(violation->field_count(), 2);
  EXPECT_EQ(Field(violation, 1), "field:string");
  EXPECT_EQ(Field(violation, 2), "description:string");
}

TEST(WireCompatibilityTest, RetryInfoIsGoogleRpcRetryInfo) {
  const Descriptor* retry = v1::RetryInfo::descriptor();
  EXPECT_EQ(retry->field_count(), 1);
  EXPECT_EQ(retry->FindFieldByNumber(1)->message_type()->full_name(), "google.protobuf.Duration");
}

// Clients and servers of different releases understand each other while these numbers stand.
TEST(WireCompatibilityTest, RepresentativesKeepTheNumbersOfOlderFields) {
  const Descriptor* query = v1::DistributionQuery::descriptor();
  EXPECT_EQ(Field(query, 1), "action_ids:message");
  EXPECT_EQ(Field(query, 2), "min_probability:double");
  EXPECT_EQ(Field(query, 3), "top_k:int32");
  EXPECT_EQ(Field(query, 6), "omit_sigma_trajectories:bool");
  EXPECT_EQ(Field(query, 7), "representatives:int32");
  const Descriptor* target = v1::TargetPrediction::descriptor();
  EXPECT_EQ(Field(target, 3), "probabilities:double*");
  EXPECT_EQ(Field(target, 4), "distributions:message*");
  EXPECT_EQ(Field(target, 5), "representatives:message*");
  const Descriptor* representative = v1::Representative::descriptor();
  EXPECT_EQ(Field(representative, 1), "action_id:int32");
  EXPECT_EQ(Field(representative, 2), "weight:double");
}

TEST(WireCompatibilityTest, CombinationsKeepTheNumbersOfOlderFields) {
  EXPECT_EQ(Field(v1::DistributionQuery::descriptor(), 8), "joint_combinations:int32");
  EXPECT_EQ(Field(v1::ScenarioPrediction::descriptor(), 6), "joint:message");
  const Descriptor* joint = v1::JointPrediction::descriptor();
  EXPECT_EQ(Field(joint, 1), "target_ids:int64*");
  EXPECT_EQ(Field(joint, 2), "combinations:message*");
  EXPECT_EQ(Field(joint, 3), "truncated:bool");
  const Descriptor* combination = v1::JointCombination::descriptor();
  EXPECT_EQ(Field(combination, 1), "action_ids:int32*");
  EXPECT_EQ(Field(combination, 2), "log_probability:double");
  EXPECT_EQ(Field(combination, 3), "weight:double");
}

}  // namespace
}  // namespace maneuver
