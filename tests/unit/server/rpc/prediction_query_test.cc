#include "server/rpc/prediction_query.h"

#include <gtest/gtest.h>

#include "tests/unit/server/rpc/prediction_messages.h"

namespace maneuver::rpc::prediction_query_test {
namespace {

TEST(ParseQueryTest, TheDefaultIsEveryActionOfAtLeastFivePercentFromThePosterior) {
  const auto describe = ParseQuery({}, 3);
  ASSERT_TRUE(describe.ok());
  EXPECT_EQ(std::get<serving::AtLeast>(describe->selection).probability, 0.05);
  EXPECT_EQ(describe->source, inference::LatentSource::kPosterior);
  EXPECT_EQ(describe->representatives, 0);
}

TEST(ParseQueryTest, RepresentativesCombineWithAnySelection) {
  const auto describe =
      ParseQuery(FromText<v1::DistributionQuery>("top_k: 2 representatives: 3"), 3);
  ASSERT_TRUE(describe.ok());
  EXPECT_EQ(std::get<serving::TopK>(describe->selection).k, 2);
  EXPECT_EQ(describe->representatives, 3);
  EXPECT_EQ(describe->combinations, 0);
  EXPECT_EQ(ParseQuery(FromText<v1::DistributionQuery>("joint_combinations: 5"), 3)->combinations,
            5);
}

TEST(ParseQueryTest, NamesTheWrongField) {
  const auto field = [](const std::string& text) {
    const auto describe = ParseQuery(FromText<v1::DistributionQuery>(text), 3);
    return describe.ok() ? "" : FirstField(describe.status());
  };
  EXPECT_EQ(field("action_ids { ids: [ 2, 0 ] }"), "");
  EXPECT_EQ(field("action_ids { ids: [ 0, 3 ] }"), "query.action_ids.ids[1]");
  EXPECT_EQ(field("action_ids { ids: -1 }"), "query.action_ids.ids[0]");
  EXPECT_EQ(field("action_ids { ids: [ 1, 1 ] }"), "query.action_ids.ids[1]");
  EXPECT_EQ(field("action_ids { }"), "query.action_ids.ids");
  EXPECT_EQ(field("min_probability: 0"), "");
  EXPECT_EQ(field("min_probability: 1.1"), "query.min_probability");
  EXPECT_EQ(field("min_probability: nan"), "query.min_probability");
  EXPECT_EQ(field("top_k: 0"), "query.top_k");
  EXPECT_EQ(field("representatives: 4"), "query.representatives");
  EXPECT_EQ(field("representatives: -1"), "query.representatives");
  EXPECT_EQ(field("joint_combinations: 64"), "");
  EXPECT_EQ(field("joint_combinations: 65"), "query.joint_combinations");
  EXPECT_EQ(field("joint_combinations: -1"), "query.joint_combinations");
  EXPECT_EQ(field("source: LATENT_SOURCE_PRIOR frame: FRAME_TARGET"), "");
  v1::DistributionQuery unknown;
  unknown.set_source(static_cast<v1::LatentSource>(9));
  EXPECT_EQ(FirstField(ParseQuery(unknown, 3).status()), "query.source");
  unknown.clear_source();
  unknown.set_frame(static_cast<v1::Frame>(9));
  EXPECT_EQ(FirstField(ParseQuery(unknown, 3).status()), "query.frame");
}

}  // namespace
}  // namespace maneuver::rpc::prediction_query_test
