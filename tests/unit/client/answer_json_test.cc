#include "client/cli/answer_json.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <string>

#include "maneuver/v1/status.pb.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::cli::answer_json_test {
namespace {

using ::testing::HasSubstr;

v1::Job JobThatFailed() {
  v1::ErrorInfo info;
  info.set_reason("TRAINING_DIVERGED");
  v1::Job job;
  job.set_name("jobs/a");
  job.set_state(v1::JOB_STATE_FAILED);
  job.mutable_error()->set_message("it diverged");
  google::protobuf::Any& detail = *job.mutable_error()->add_details();
  detail.set_type_url("type.googleapis.com/google.rpc.ErrorInfo");
  detail.set_value(info.SerializeAsString());
  return job;
}

TEST(AnswerJsonTest, WritesTheDetailsOfErrors) {
  const auto json = ToAnswerJson(JobThatFailed());
  ASSERT_TRUE(json.ok()) << json.status();
  for (const char* part : {R"("name": "jobs/a")", R"("message": "it diverged")",
                           R"("@type": "type.googleapis.com/google.rpc.ErrorInfo")",
                           R"("reason": "TRAINING_DIVERGED")"}) {
    EXPECT_THAT(*json, HasSubstr(part));
  }
}

TEST(AnswerJsonTest, WritesMessagesWithoutDetailsAsProtobufDoes) {
  v1::Job job = JobThatFailed();
  job.mutable_error()->clear_details();
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  std::string expected;
  ASSERT_TRUE(google::protobuf::util::MessageToJsonString(job, &expected, options).ok());
  EXPECT_EQ(ToAnswerJson(job).value_or("none"), expected);
}

TEST(AnswerJsonTest, RefusesATypeThatNobodyKnows) {
  v1::Job job = JobThatFailed();
  job.mutable_error()->mutable_details(0)->set_type_url("type.googleapis.com/google.rpc.Unheard");
  job.mutable_error()->mutable_details(0)->set_value("\x0a\x01x");
  EXPECT_EQ(ToAnswerJson(job).status().code(), absl::StatusCode::kInternal);
}

}  // namespace
}  // namespace maneuver::cli::answer_json_test
