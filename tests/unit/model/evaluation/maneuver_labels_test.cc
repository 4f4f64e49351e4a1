#include "model/evaluation/maneuver_labels.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace maneuver::evaluation::maneuver_labels_test {
namespace {

v1::ManeuverAnnotation Annotation(int64_t agent, double start, double end, const char* name) {
  v1::ManeuverAnnotation annotation;
  annotation.set_scenario_id("scene");
  annotation.set_agent_id(agent);
  annotation.set_start_time(start);
  annotation.set_end_time(end);
  annotation.set_maneuver(name);
  return annotation;
}

TEST(ManeuverLabelsTest, ReturnsTheManeuverThatCoversMostOfTheWindow) {
  const std::vector annotations = {Annotation(1, 0.0, 4.0, "keep_lane"),
                                   Annotation(1, 4.0, 9.0, "turn_left")};
  const ManeuverLabels labels(annotations);
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 0.0, 5.0)], "keep_lane");
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 2.0, 7.0)], "turn_left");
}

TEST(ManeuverLabelsTest, SumsIntervalsOfTheSameName) {
  const std::vector annotations = {Annotation(1, 0.0, 2.0, "stop"),
                                   Annotation(1, 2.0, 5.0, "keep_lane"),
                                   Annotation(1, 5.0, 7.0, "stop")};
  const ManeuverLabels labels(annotations);
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 0.0, 7.0)], "stop");
}

TEST(ManeuverLabelsTest, AMomentCountsOnlyForWindowsThatStartNearIt) {
  const std::vector annotations = {Annotation(1, 2.0, 2.0, "turn_left"),
                                   Annotation(1, 2.2, 2.2, "stop")};
  const ManeuverLabels labels(annotations);
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 2.05, 7.0)], "turn_left");
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 2.2, 7.0)], "stop");
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 1.75, 7.0)], "turn_left");
  // It lies within this window but not near its start.
  EXPECT_FALSE(labels.Over("scene", 1, 1.5, 7.0).has_value());
  EXPECT_FALSE(labels.Over("scene", 1, 2.5, 7.0).has_value());
}

TEST(ManeuverLabelsTest, AMomentTakesPrecedenceOverIntervals) {
  const std::vector annotations = {Annotation(1, 0.0, 9.0, "keep_lane"),
                                   Annotation(1, 2.0, 2.0, "turn_left")};
  const ManeuverLabels labels(annotations);
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 2.0, 7.0)], "turn_left");
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 3.0, 8.0)], "keep_lane");
}

TEST(ManeuverLabelsTest, OfTheLabelsOfAMomentTheLastCounts) {
  const std::vector annotations = {
      Annotation(1, 2.0, 2.0, "turn_left"), Annotation(1, 2.0, 2.0, "keep_lane"),
      Annotation(1, 2.2, 2.2, "stop"), Annotation(1, 2.2, 2.2, "start")};
  const ManeuverLabels labels(annotations);
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 2.0, 7.0)], "keep_lane");
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 2.05, 7.0)], "keep_lane");
  EXPECT_EQ(labels.names()[*labels.Over("scene", 1, 2.2, 7.0)], "start");
  // A name that was corrected everywhere is none.
  EXPECT_EQ(labels.names(), (std::vector<std::string>{"keep_lane", "start"}));
}

TEST(ManeuverLabelsTest, ReturnsNothingForOtherAgentsAndTimes) {
  const std::vector annotations = {Annotation(1, 0.0, 2.0, "stop")};
  const ManeuverLabels labels(annotations);
  EXPECT_FALSE(labels.Over("scene", 2, 0.0, 2.0).has_value());
  EXPECT_FALSE(labels.Over("other", 1, 0.0, 2.0).has_value());
  EXPECT_FALSE(labels.Over("scene", 1, 3.0, 8.0).has_value());
}

}  // namespace
}  // namespace maneuver::evaluation::maneuver_labels_test
