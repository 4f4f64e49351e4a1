#include "server/errors/error_details.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "maneuver/v1/status.pb.h"

namespace maneuver::errors {
namespace {

TEST(InvalidFieldsTest, ListsSixteenAndCountsTheOthers) {
  const std::vector<scene::FieldViolation> violations(1000, {"weights", "is wrong"});
  const absl::Status status = InvalidFields(violations);
  EXPECT_EQ(status.message(), "weights: is wrong (and 999 more)");
  v1::BadRequest listed;
  const auto detail = status.GetPayload("type.googleapis.com/google.rpc.BadRequest");
  ASSERT_TRUE(detail.has_value());
  ASSERT_TRUE(listed.ParseFromString(std::string(*detail)));
  EXPECT_EQ(listed.field_violations_size(), 16);
}

}  // namespace
}  // namespace maneuver::errors
