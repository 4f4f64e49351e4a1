#include "server/security/resource_name.h"

#include <gtest/gtest.h>

#include "maneuver/v1/status.pb.h"
#include "server/errors/error_details.h"

namespace maneuver::security::resource_name_test {
namespace {

TEST(ResourceNameTest, ReferencesMeanAVersionOrAnAlias) {
  EXPECT_EQ(std::get<ModelAliasName>(*ParseModelReference("models/town", "model")),
            (ModelAliasName{"town", "serving"}));
  EXPECT_EQ(std::get<ModelAliasName>(*ParseModelReference("models/town@candidate", "model")),
            (ModelAliasName{"town", "candidate"}));
  EXPECT_EQ(std::get<ModelVersionName>(*ParseModelReference("models/town/versions/12", "model")),
            (ModelVersionName{"town", 12}));
}

TEST(ResourceNameTest, NamesRoundTripThroughText) {
  EXPECT_EQ(ParseModelVersionName("models/a-1/versions/3", "name")->ToString(),
            "models/a-1/versions/3");
  EXPECT_EQ(ParseModelAliasName("models/a/aliases/b", "name")->ToString(), "models/a/aliases/b");
  EXPECT_EQ(ParseEvaluationName("models/a/versions/3/evaluations/b-1", "name")->ToString(),
            "models/a/versions/3/evaluations/b-1");
  EXPECT_EQ(*ParseDatasetName("datasets/x", "name"), "x");
  EXPECT_EQ(*ParseJobName("jobs/0a-b", "name"), "0a-b");
  EXPECT_EQ(*ParseModelName("models/" + std::string(63, 'a'), "parent"), std::string(63, 'a'));
}

class HostileNameTest : public ::testing::TestWithParam<std::string> {};

TEST_P(HostileNameTest, IsNotAnId) {
  const std::string& id = GetParam();
  EXPECT_FALSE(ParseModelName("models/" + id, "name").ok());
  EXPECT_FALSE(ParseModelReference("models/" + id, "name").ok());
  EXPECT_FALSE(ParseModelReference("models/town@" + id, "name").ok());
  EXPECT_FALSE(ParseModelVersionName("models/" + id + "/versions/1", "name").ok());
  EXPECT_FALSE(ParseModelVersionName("models/town/versions/" + id, "name").ok());
  EXPECT_FALSE(ParseModelAliasName("models/town/aliases/" + id, "name").ok());
  EXPECT_FALSE(ParseEvaluationName("models/town/versions/1/evaluations/" + id, "name").ok());
  EXPECT_FALSE(ParseEvaluationName("models/" + id + "/versions/1/evaluations/x", "name").ok());
  EXPECT_FALSE(ParseDatasetName("datasets/" + id, "name").ok());
  EXPECT_FALSE(ParseJobName("jobs/" + id, "name").ok());
}

INSTANTIATE_TEST_SUITE_P(All, HostileNameTest,
                         ::testing::Values("", ".", "..", "../town", "town/..", "a/b",
                                           "/etc/passwd", "a%2e%2e", "Town", "-a", "a b", "a\n",
                                           std::string("a\0b", 3), "a.b", "ä", "a_b", "~",
                                           "http://x", std::string(64, 'a')));

TEST(ResourceNameTest, VersionsAreCanonicalNumbers) {
  EXPECT_EQ(ParseVersion("7"), 7);
  EXPECT_EQ(ParseVersion("999999999"), 999999999);
  for (const char* text : {"", "0", "01", "-1", "+1", "1 ", " 1", "1.0", "1000000000", "1e3"}) {
    EXPECT_EQ(ParseVersion(text), 0) << text;
  }
}

TEST(ResourceNameTest, ErrorsNameTheFieldOfTheRequest) {
  const v1::Status status = errors::ToProto(ParseDatasetName("../x", "datasets[1]").status());
  EXPECT_EQ(status.code(), 3);
  v1::BadRequest detail;
  ASSERT_EQ(status.details_size(), 2);
  EXPECT_EQ(status.details(1).type_url(), "type.googleapis.com/google.rpc.BadRequest");
  ASSERT_TRUE(detail.ParseFromString(status.details(1).value()));
  EXPECT_EQ(detail.field_violations(0).field(), "datasets[1]");
}

TEST(ErrorDetailsTest, SurvivesTheWire) {
  const absl::Status status = errors::WithRetryDelay(
      errors::WithReason(absl::ResourceExhaustedError("later"), "QUEUE_FULL", {{"a", "b"}}),
      std::chrono::milliseconds(2500));
  const absl::Status back = errors::FromProto(errors::ToProto(status));
  EXPECT_EQ(back, status);
  EXPECT_EQ(errors::RetryDelay(back), std::chrono::milliseconds(2500));
}

TEST(ErrorDetailsTest, ViolationsArePrefixedAndCounted) {
  const absl::Status status =
      errors::InvalidFields({{"agents[0].length", "not positive"}, {"x", "y"}}, "scenarios[2]");
  EXPECT_EQ(status.message(), "scenarios[2].agents[0].length: not positive (and 1 more)");
}

}  // namespace
}  // namespace maneuver::security::resource_name_test
