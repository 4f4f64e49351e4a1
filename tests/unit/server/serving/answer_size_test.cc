#include "server/serving/answer_size.h"

#include <gtest/gtest.h>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::serving::answer_size_test {
namespace {

constexpr int kActions = 25;
constexpr int kLatents = 5;
constexpr int kWaypoints = 50;

v1::ModelSpec Spec() {
  v1::ModelSpec spec;
  spec.set_actions(kActions);
  spec.set_latent_dimensions(kLatents);
  spec.mutable_trajectory()->set_waypoints(kWaypoints);
  return spec;
}

void Fill(int count, google::protobuf::RepeatedField<double>* field) {
  for (int i = 0; i < count; ++i) field->Add(0.1);
}

void Fill(v1::Trajectory* trajectory) {
  Fill(kWaypoints, trajectory->mutable_x());
  Fill(kWaypoints, trajectory->mutable_y());
}

// Bytes of an answer with `actions` distributions, in a message around it.
int64_t Bytes(int actions, bool sigma_trajectories, int representatives, int combinations = 0) {
  v1::ScenarioPrediction scenario;
  v1::TargetPrediction& target = *scenario.add_targets();
  target.set_target_id(-1);  // the longest
  Fill(kActions, target.mutable_probabilities());
  for (int i = 0; i < actions; ++i) {
    v1::ActionDistribution& action = *target.add_distributions();
    action.set_action_id(kActions);
    action.set_probability(0.3);
    Fill(kLatents, action.mutable_latent_mean());
    Fill(kLatents, action.mutable_latent_stddev());
    Fill(action.mutable_mean_trajectory());
    for (int p = 0; sigma_trajectories && p < 2 * kLatents + 1; ++p) {
      Fill(action.add_sigma_trajectories());
    }
    v1::WaypointMoments& moments = *action.mutable_moments();
    for (auto* field :
         {moments.mutable_mean_x(), moments.mutable_mean_y(), moments.mutable_covariance_xx(),
          moments.mutable_covariance_xy(), moments.mutable_covariance_yy()}) {
      Fill(kWaypoints, field);
    }
  }
  for (int i = 0; i < representatives; ++i) {
    v1::Representative& representative = *target.add_representatives();
    representative.set_action_id(kActions);
    representative.set_weight(0.1);
  }
  if (combinations > 0) scenario.mutable_joint()->add_target_ids(-1);
  for (int i = 0; i < combinations; ++i) {
    v1::JointCombination& combination = *scenario.mutable_joint()->add_combinations();
    combination.add_action_ids(kActions);
    combination.set_log_probability(-0.1);
    combination.set_weight(0.1);
  }
  return static_cast<int64_t>(scenario.ByteSizeLong());
}

void ExpectBound(int64_t bound, int64_t bytes) {
  EXPECT_GE(bound, bytes);
  EXPECT_LE(bound, bytes + bytes / 20);  // and is not far from it
}

TEST(AnswerSizeTest, IsATightUpperBound) {
  for (const bool sigma : {true, false}) {
    ExpectBound(MostBytesOfTarget(Spec(), DescribeActions{AtLeast{0.0}}, sigma),
                Bytes(kActions, sigma, 0));
    ExpectBound(MostBytesOfTarget(Spec(), DescribeActions{TopK{3}}, sigma), Bytes(3, sigma, 0));
    ExpectBound(MostBytesOfTarget(Spec(), DescribeActions{ActionIds{{1, 5}}}, sigma),
                Bytes(2, sigma, 0));
    // At most 20 actions have a twentieth of the probability.
    ExpectBound(MostBytesOfTarget(Spec(), DescribeActions{AtLeast{0.05}}, sigma),
                Bytes(20, sigma, 0));
    ExpectBound(MostBytesOfTarget(Spec(), DescribeActions{TopK{3}, {}, 4}, sigma),
                Bytes(7, sigma, 4));
  }
}

// The combinations name at most 12 actions of a target.
TEST(AnswerSizeTest, CountsTheActionsAndTheNumbersOfCombinations) {
  for (const int combinations : {5, 64}) {
    DescribeActions question{TopK{1}};
    question.combinations = combinations;
    const int64_t bytes = Bytes(1 + std::min(combinations, 12), false, 0, combinations);
    const int64_t most = MostBytesOfAnswer(Spec(), question, false, 1, 1);
    EXPECT_GE(most, bytes);
    EXPECT_LE(most, kScenarioBytes + bytes + bytes / 4);
  }
}

TEST(AnswerSizeTest, NeverCountsMoreActionsThanThereAre) {
  EXPECT_EQ(MostBytesOfTarget(Spec(), DescribeActions{TopK{1'000'000'000}}, true),
            MostBytesOfTarget(Spec(), DescribeActions{AtLeast{0.0}}, true));
}

TEST(AnswerSizeTest, LeavesRoomForAnErrorInSmallAnswers) {
  EXPECT_GE(MostBytesOfTarget(Spec(), {}, true), kTargetErrorBytes);
  v1::ModelSpec small = Spec();
  small.set_actions(2);
  EXPECT_EQ(MostBytesOfTarget(small, ClassifyTrajectory(), true), kTargetErrorBytes);
}

}  // namespace
}  // namespace maneuver::serving::answer_size_test
