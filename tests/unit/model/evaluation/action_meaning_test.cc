#include "model/evaluation/action_meaning.h"

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

namespace maneuver::evaluation {
namespace {

// Examples of two actions.
class ActionMeaningTest : public testing::Test {
 protected:
  void Add(int times, int action, double speed, KinematicClass kinematic, RelativeClass relative,
           std::optional<int> maneuver = std::nullopt) {
    Measurement measured;
    measured.action = action;
    measured.keys.speed = speed;
    measured.keys.kinematic_class = kinematic;
    measured.relative_class = relative;
    measured.maneuver = maneuver;
    measured_.insert(measured_.end(), static_cast<size_t>(times), measured);
  }

  v1::EvaluationReport Report() const {
    v1::EvaluationReport report;
    for (int action = 0; action < 3; ++action) report.add_action_uses();
    ActionMeaning meaning;
    for (const Measurement& each : measured_) meaning.Add(each);
    meaning.Write(report);
    return report;
  }

  std::vector<Measurement> measured_;
};

// The actions encode how fast a vehicle is, and nothing about what it does.
TEST_F(ActionMeaningTest, ActionsThatEncodeSpeedTellNothingGivenTheSpeed) {
  using enum RelativeClass;
  for (const auto relative : {kKeepsSpeed, kBrakes}) {
    Add(100, 0, 3.0, KinematicClass::kStraightSlow, relative);
    Add(100, 1, 12.0, KinematicClass::kStraightFast, relative);
  }
  const v1::EvaluationReport report = Report();
  const auto& metrics = report.metrics();
  EXPECT_NEAR(metrics.at("nmi_kinematic"), 1.0, 1e-12);
  EXPECT_DOUBLE_EQ(metrics.at("class_information_kinematic"), 0.0);
  EXPECT_NEAR(metrics.at("nmi_relative"), 0.0, 1e-12);
  EXPECT_DOUBLE_EQ(metrics.at("purity_relative"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("class_information_relative"), 0.0);
  EXPECT_DOUBLE_EQ(metrics.at("named_share_relative"), 0.0);
}

// The actions encode what a driver does, at any speed. I(action; kinematic class) is 0.
TEST_F(ActionMeaningTest, ActionsThatEncodeBehaviourTellItAtEverySpeed) {
  for (const double speed : {3.0, 12.0}) {
    const auto kinematic =
        speed > 10.0 ? KinematicClass::kStraightFast : KinematicClass::kStraightSlow;
    Add(100, 0, speed, kinematic, RelativeClass::kKeepsSpeed);
    Add(100, 1, speed, kinematic, RelativeClass::kBrakes);
  }
  const v1::EvaluationReport report = Report();
  const auto& metrics = report.metrics();
  EXPECT_NEAR(metrics.at("nmi_kinematic"), 0.0, 1e-12);
  EXPECT_NEAR(metrics.at("nmi_relative"), 1.0, 1e-12);
  EXPECT_DOUBLE_EQ(metrics.at("purity_relative"), 1.0);
  EXPECT_NEAR(metrics.at("class_information_relative"), 1.0, 1e-12);
  EXPECT_DOUBLE_EQ(metrics.at("named_share_relative"), 1.0);
}

TEST_F(ActionMeaningTest, AnActionIsNamedFromSevenTenths) {
  Add(7, 0, 5.0, KinematicClass::kStraightSlow, RelativeClass::kBrakes);
  Add(3, 0, 5.0, KinematicClass::kStationary, RelativeClass::kStops);
  Add(13, 2, 5.0, KinematicClass::kLeftTurn, RelativeClass::kTurnsLeft);
  Add(7, 2, 5.0, KinematicClass::kLeftTurn, RelativeClass::kStarts);
  const v1::EvaluationReport report = Report();
  EXPECT_DOUBLE_EQ(report.metrics().at("named_share_relative"), 10.0 / 30.0);
  EXPECT_EQ(report.action_uses(0).examples(), 10);
  EXPECT_EQ(report.action_uses(0).relative_class(), "brakes");
  EXPECT_DOUBLE_EQ(report.action_uses(0).relative_class_share(), 0.7);
  EXPECT_EQ(report.action_uses(0).kinematic_class(), "straight_slow");
  EXPECT_DOUBLE_EQ(report.action_uses(0).class_share(), 0.7);
  EXPECT_EQ(report.action_uses(1).examples(), 0);
  EXPECT_EQ(report.action_uses(1).relative_class(), "");
  EXPECT_EQ(report.action_uses(2).relative_class(), "turns_left");
  EXPECT_DOUBLE_EQ(report.action_uses(2).relative_class_share(), 0.65);
}

TEST_F(ActionMeaningTest, MeasuresRecordedManoeuvresWhereThereAreAny) {
  Add(4, 0, 5.0, KinematicClass::kStraightSlow, RelativeClass::kBrakes);
  EXPECT_FALSE(Report().metrics().contains("nmi"));
  Add(2, 0, 5.0, KinematicClass::kStraightSlow, RelativeClass::kBrakes, 8);
  Add(3, 1, 5.0, KinematicClass::kStraightSlow, RelativeClass::kBrakes, 9);
  const v1::EvaluationReport report = Report();
  EXPECT_NEAR(report.metrics().at("nmi"), 1.0, 1e-12);
  EXPECT_DOUBLE_EQ(report.metrics().at("purity"), 1.0);
  EXPECT_DOUBLE_EQ(report.metrics().at("labelled_examples"), 5.0);
}

}  // namespace
}  // namespace maneuver::evaluation
