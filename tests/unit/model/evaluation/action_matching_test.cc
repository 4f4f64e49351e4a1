#include "model/evaluation/action_matching.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "model/evaluation/action_coincidence.h"
#include "model/evaluation/action_matching_text.h"

namespace maneuver::evaluation {
namespace {

using testing::HasSubstr;

constexpr int kWaypoints = 10;  // 5 s at 2 Hz

v1::ModelManifest EmptyManifest() {
  v1::ModelManifest manifest;
  v1::TrajectorySpec& trajectory = *manifest.mutable_spec()->mutable_trajectory();
  trajectory.set_waypoints(kWaypoints);
  trajectory.mutable_waypoint_interval()->set_nanos(500'000'000);
  return manifest;
}

// Adds an effective action that moves evenly along a straight line to (x, y).
void AddAction(v1::ModelManifest& manifest, double x, double y, double usage) {
  v1::Action& action = *manifest.add_actions();
  action.set_action_id(manifest.actions_size() - 1);
  action.set_usage(usage);
  action.set_effective(true);
  for (int i = 1; i <= kWaypoints; ++i) {
    action.mutable_distribution()->mutable_mean_trajectory()->add_x(x * i / kWaypoints);
    action.mutable_distribution()->mutable_mean_trajectory()->add_y(y * i / kWaypoints);
  }
}

std::vector<int> PartnersOf(const v1::ActionMatching& matching, int actions) {
  std::vector<int> partners(static_cast<size_t>(actions), -1);
  for (const v1::ActionPair& pair : matching.pairs()) {
    partners[static_cast<size_t>(pair.first().action_id())] = pair.second().action_id();
  }
  return partners;
}

TEST(ActionMatchingTest, MatchesAPermutedSetAtDistanceZero) {
  const std::vector<int> permutation = {3, 0, 4, 1, 2};  // second action of each first one
  v1::ModelManifest first = EmptyManifest();
  v1::ModelManifest second = EmptyManifest();
  second.mutable_spec()->set_actions(5);
  std::vector<std::vector<double>> ends = {{5, 0}, {20, 0}, {20, 8}, {40, -3}, {12, -15}};
  std::vector<std::vector<double>> permuted(5);
  for (size_t i = 0; i < 5; ++i) permuted[static_cast<size_t>(permutation[i])] = ends[i];
  for (const auto& end : ends) AddAction(first, end[0], end[1], 0.2);
  for (const auto& end : permuted) AddAction(second, end[0], end[1], 0.2);

  const auto matching = MatchActions(first, second);
  ASSERT_TRUE(matching.ok()) << matching.status();
  EXPECT_EQ(PartnersOf(*matching, 5), permutation);
  for (const v1::ActionPair& pair : matching->pairs()) EXPECT_EQ(pair.distance(), 0.0);
  EXPECT_EQ(matching->mean_distance(), 0.0);
  EXPECT_NEAR(matching->agreeing_share_first(), 1.0, 1e-12);
  EXPECT_NEAR(matching->agreeing_share_second(), 1.0, 1e-12);
}

// Straight ahead by 20 m against 22 m, and by 40 m against 50 m. A straight line whose end is d
// away is on average d (1 + ... + T) / T^2 = 0.55 d away: 1.1 m and 5.5 m.
TEST(ActionMatchingTest, FiguresMatchAHandComputedCase) {
  v1::ModelManifest first = EmptyManifest();
  AddAction(first, 20.0, 0.0, 0.7);
  AddAction(first, 40.0, 0.0, 0.3);
  v1::ModelManifest second = EmptyManifest();
  AddAction(second, 50.0, 0.0, 0.4);
  AddAction(second, 22.0, 0.0, 0.5);
  AddAction(second, 0.0, 0.0, 0.1);
  second.mutable_actions(2)->set_label("waiting");

  const auto matching = MatchActions(first, second);
  ASSERT_TRUE(matching.ok()) << matching.status();
  ASSERT_EQ(matching->pairs_size(), 2);
  EXPECT_EQ(PartnersOf(*matching, 2), (std::vector<int>{1, 0}));
  EXPECT_NEAR(matching->pairs(0).distance(), 1.1, 1e-9);  // the closest first
  EXPECT_NEAR(matching->pairs(1).distance(), 5.5, 1e-9);
  EXPECT_NEAR(matching->mean_distance(), (0.6 * 1.1 + 0.35 * 5.5) / 0.95, 1e-9);
  EXPECT_NEAR(matching->tolerance(), 2.0, 1e-9);
  EXPECT_NEAR(matching->agreeing_share_first(), 0.7, 1e-12);
  EXPECT_NEAR(matching->agreeing_share_second(), 0.5, 1e-12);
  ASSERT_EQ(matching->unpaired_second_size(), 1);
  EXPECT_EQ(matching->unpaired_second(0).action_id(), 2);
  EXPECT_EQ(matching->unpaired_second(0).kinematic_class(), "stationary");
  EXPECT_EQ(matching->pairs(0).first().kinematic_class(), "straight_slow");

  const std::string text = ActionMatchingText(*matching, std::vector<std::string>{"slow", "fast"},
                                              std::vector<std::string>{"hurry", "stroll", "wait"});
  EXPECT_THAT(text, HasSubstr("     0   70.0 %  slow  1.10 m       1   50.0 %  stroll\n"));
  EXPECT_THAT(text, HasSubstr("       -       2   10.0 %  wait\n"));
  EXPECT_THAT(text, HasSubstr("partner in 2.0 m  70.0 % and 50.0 %"));
}

// "Slows down a little" and "arrives 20 m ahead" are close only at one speed.
TEST(ActionMatchingTest, RefusesModelsOfWhichOnlyOneIsRelativeToTheMotion) {
  v1::ModelManifest metres = EmptyManifest();
  AddAction(metres, 20.0, 0.0, 1.0);
  v1::ModelManifest relative = metres;
  relative.mutable_spec()->set_reference(v1::TRAJECTORY_REFERENCE_FADING_MOTION);
  EXPECT_EQ(MatchActions(metres, relative).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(MatchActions(relative, metres).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(MatchActions(relative, relative).ok());
  metres.mutable_spec()->set_reference(v1::TRAJECTORY_REFERENCE_NONE);
  EXPECT_TRUE(MatchActions(metres, metres).ok());
}

TEST(ActionMatchingTest, IneffectiveActionsAreNotPaired) {
  v1::ModelManifest first = EmptyManifest();
  AddAction(first, 20.0, 0.0, 1.0);
  v1::ModelManifest second = EmptyManifest();
  AddAction(second, 20.0, 0.0, 0.0);
  second.mutable_actions(0)->set_effective(false);
  AddAction(second, 21.0, 0.0, 1.0);
  const auto matching = MatchActions(first, second);
  ASSERT_TRUE(matching.ok());
  EXPECT_EQ(PartnersOf(*matching, 1), std::vector<int>{1});
  EXPECT_EQ(matching->unpaired_second_size(), 0);
}

// By distance alone, 20 m would be paired with 10 m and 23 m with 22 m: 11 < 2 + 13.
TEST(ActionMatchingTest, RareActionsDoNotSeparateFrequentOnes) {
  v1::ModelManifest first = EmptyManifest();
  AddAction(first, 20.0, 0.0, 0.95);
  AddAction(first, 23.0, 0.0, 0.05);
  v1::ModelManifest second = EmptyManifest();
  AddAction(second, 22.0, 0.0, 0.95);
  AddAction(second, 10.0, 0.0, 0.05);
  const auto matching = MatchActions(first, second);
  ASSERT_TRUE(matching.ok());
  EXPECT_EQ(PartnersOf(*matching, 2), (std::vector<int>{0, 1}));
}

// 20 m is nearer to the rare 19 m than to 22 m, which would then have no partner.
TEST(ActionMatchingTest, AFrequentActionIsNotLeftUnpaired) {
  v1::ModelManifest first = EmptyManifest();
  AddAction(first, 20.0, 0.0, 0.9);
  AddAction(first, 60.0, 0.0, 0.1);
  v1::ModelManifest second = EmptyManifest();
  AddAction(second, 60.0, 0.0, 0.1);
  AddAction(second, 19.0, 0.0, 0.02);
  AddAction(second, 22.0, 0.0, 0.88);
  const auto matching = MatchActions(first, second);
  ASSERT_TRUE(matching.ok());
  EXPECT_EQ(PartnersOf(*matching, 2), (std::vector<int>{2, 0}));
  ASSERT_EQ(matching->unpaired_second_size(), 1);
  EXPECT_EQ(matching->unpaired_second(0).action_id(), 1);
  // The same from the other side.
  const auto turned = MatchActions(second, first);
  ASSERT_TRUE(turned.ok());
  EXPECT_EQ(PartnersOf(*turned, 3), (std::vector<int>{1, -1, 0}));
  EXPECT_EQ(turned->unpaired_first_size(), 1);
  EXPECT_EQ(turned->unpaired_second_size(), 0);
}

TEST(ActionMatchingTest, RefusesModelsThatCannotBeCompared) {
  v1::ModelManifest first = EmptyManifest();
  AddAction(first, 20.0, 0.0, 1.0);
  v1::ModelManifest slower = first;
  slower.mutable_spec()->mutable_trajectory()->mutable_waypoint_interval()->set_nanos(400'000'000);
  EXPECT_EQ(MatchActions(first, slower).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(MatchActions(first, EmptyManifest()).status().code(),
            absl::StatusCode::kInvalidArgument);
  v1::ModelManifest damaged = first;
  damaged.mutable_actions(0)
      ->mutable_distribution()
      ->mutable_mean_trajectory()
      ->mutable_y()
      ->RemoveLast();
  EXPECT_EQ(MatchActions(first, damaged).status().code(), absl::StatusCode::kInvalidArgument);
}

// Two equally frequent actions; the second model splits one of them in two.
TEST(ActionMatchingTest, CoincidenceMeasuresPairsAndMutualInformation) {
  v1::ActionMatching matching;
  for (int i = 0; i < 2; ++i) {
    v1::ActionPair& pair = *matching.add_pairs();
    pair.mutable_first()->set_action_id(i);
    pair.mutable_second()->set_action_id(1 - i);
  }
  const ActionPairs pairs = {{{0, 1}, 4}, {{1, 0}, 2}, {{1, 2}, 2}};
  const v1::ActionCoincidence coincidence = CoincidenceOf(pairs, matching);
  EXPECT_EQ(coincidence.examples(), 8);
  EXPECT_DOUBLE_EQ(coincidence.paired_share(), 0.75);
  // I = H(first) = ln 2, H(second) = 1.5 ln 2: 2 / 2.5.
  EXPECT_NEAR(coincidence.normalized_mutual_information(), 0.8, 1e-12);
}

}  // namespace
}  // namespace maneuver::evaluation
