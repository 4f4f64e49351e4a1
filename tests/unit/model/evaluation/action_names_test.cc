#include "model/evaluation/action_names.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <set>

namespace maneuver::evaluation::action_names_test {
namespace {

using testing::Each;
using testing::ElementsAre;
using testing::SizeIs;

constexpr double kInterval = 0.1;  // seconds

// Where something is after so many seconds, metres.
struct Place {
  double x;
  double y;
};
using Motion = std::function<Place(double seconds)>;

v1::ModelManifest EmptyManifest(double horizon, bool relative) {
  v1::ModelManifest manifest;
  v1::TrajectorySpec& trajectory = *manifest.mutable_spec()->mutable_trajectory();
  trajectory.set_waypoints(static_cast<int>(std::lround(horizon / kInterval)));
  trajectory.mutable_waypoint_interval()->set_nanos(100'000'000);
  if (relative) manifest.mutable_spec()->set_reference(v1::TRAJECTORY_REFERENCE_FADING_MOTION);
  return manifest;
}

void AddAction(v1::ModelManifest& manifest, const Motion& motion, bool effective = true) {
  v1::Action& action = *manifest.add_actions();
  action.set_action_id(manifest.actions_size() - 1);
  action.set_effective(effective);
  v1::Trajectory& mean = *action.mutable_distribution()->mutable_mean_trajectory();
  for (int t = 1; t <= manifest.spec().trajectory().waypoints(); ++t) {
    const Place place = motion(t * kInterval);
    mean.add_x(place.x);
    mean.add_y(place.y);
  }
}

std::string NameOf(const v1::ModelManifest& manifest, const v1::ActionUse& use = {}) {
  return NameActions(manifest, std::span(&use, 1)).front();
}

// Of a model in metres.
std::string PlaceName(const Motion& motion, const v1::ActionUse& use = {}) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  AddAction(manifest, motion);
  return NameOf(manifest, use);
}

// Of a model relative to the present motion: what is added to driving on at 10 m/s.
std::string RelativeName(const Motion& deviation, const v1::ActionUse& use = {},
                         double horizon = 5.0) {
  v1::ModelManifest manifest = EmptyManifest(horizon, true);
  AddAction(manifest, [&](double t) {
    const Place added = deviation(t);
    return Place{10.0 * t + added.x, added.y};
  });
  return NameOf(manifest, use);
}

v1::ActionUse UseOf(int examples, const char* relative, double share, const char* kinematic = "") {
  v1::ActionUse use;
  use.set_examples(examples);
  use.set_relative_class(relative);
  use.set_relative_class_share(share);
  use.set_kinematic_class(kinematic);
  use.set_class_share(share);
  return use;
}

// Straight on, with constant acceleration until it stands.
Motion Straight(double speed, double acceleration) {
  return [=](double t) {
    const double moving = acceleration < 0.0 ? std::min(t, -speed / acceleration) : t;
    return Place{speed * moving + acceleration * moving * moving / 2.0, 0.0};
  };
}

// `before` metres straight on, then an arc of `radius` (negative: to the right) through `angle`
// radians, then straight on, all at `speed`.
Motion Turn(double before, double radius, double angle, double speed) {
  return [=](double t) {
    const double arc = std::abs(radius) * angle;
    const double way = speed * t;
    const double turned = std::clamp(way - before, 0.0, arc) / std::abs(radius);
    const double after = std::max(0.0, way - before - arc);
    const double side = radius > 0.0 ? 1.0 : -1.0;
    const double x =
        std::min(way, before) + std::abs(radius) * std::sin(turned) + after * std::cos(angle);
    const double y = std::abs(radius) * (1.0 - std::cos(turned)) + after * std::sin(angle);
    return Place{x, side * y};
  };
}

// To a parallel lane, over all five seconds.
Motion Shift(double speed, double metres) {
  return [=](double t) {
    return Place{speed * t, metres * (1.0 - std::cos(std::numbers::pi * t / 5.0)) / 2.0};
  };
}

// A deviation with constant accelerations.
Motion Gain(double ahead, double left) {
  return [=](double t) { return Place{ahead * t * t / 2.0, left * t * t / 2.0}; };
}

constexpr double kRight = std::numbers::pi / 2.0;  // angle

TEST(ActionNamesTest, NamesPlacesAheadByHowFastTheyAreReached) {
  EXPECT_EQ(PlaceName(Straight(0.2, 0.0)), "stand still");
  EXPECT_EQ(PlaceName(Straight(0.7, 0.0)), "creep forward");
  EXPECT_EQ(PlaceName(Straight(0.0, 2.0)), "start off");
  EXPECT_EQ(PlaceName(Straight(12.0, 0.0)), "keep straight");
  EXPECT_EQ(PlaceName(Straight(6.0, 1.0)), "speed up");
  EXPECT_EQ(PlaceName(Straight(12.0, -1.5)), "slow down");
  // v^2 / (2 a) = 36 / 3 = 12 m, after 4 s.
  EXPECT_EQ(PlaceName(Straight(6.0, -1.5)), "stop within 12 m");
  EXPECT_EQ(PlaceName(Straight(-2.0, 0.0)), "reverse");
}

TEST(ActionNamesTest, NamesTurnsBySideAndRadius) {
  EXPECT_EQ(PlaceName(Turn(5.0, 8.0, kRight, 5.0)), "left turn, tight");
  EXPECT_EQ(PlaceName(Turn(5.0, -8.0, kRight, 5.0)), "right turn, tight");
  EXPECT_EQ(PlaceName(Turn(5.0, 20.0, kRight, 8.0)), "left turn");
  EXPECT_EQ(PlaceName(Turn(0.0, 60.0, kRight / 2.0, 10.0)), "left turn, wide");
  EXPECT_EQ(PlaceName(Turn(0.0, -100.0, kRight / 3.0, 5.0)), "bear right");  // 14 degrees
  EXPECT_EQ(PlaceName(Turn(5.0, 5.0, 2.0 * kRight, 6.0)), "U-turn left");
}

// The way to the corner and from it does not make the corner itself wider.
TEST(ActionNamesTest, TheRadiusIsThatOfTheArcAlone) {
  for (const double before : {2.0, 10.0, 20.0}) {
    EXPECT_EQ(PlaceName(Turn(before, 8.0, kRight, 8.0)), "left turn, tight") << before;
    EXPECT_EQ(PlaceName(Turn(before, -16.0, kRight, 12.0)), "right turn") << before;
  }
}

TEST(ActionNamesTest, NamesShiftsToTheSide) {
  EXPECT_EQ(PlaceName(Shift(12.0, 3.5)), "lane change left");
  EXPECT_EQ(PlaceName(Shift(12.0, -3.5)), "lane change right");
  EXPECT_EQ(PlaceName(Shift(12.0, 1.4)), "drift left");
  EXPECT_EQ(PlaceName(Shift(12.0, 0.6)), "keep straight");
  // The last metres point 5.9 degrees to the left: d = 0.4 m - 34 m tan(2.9 degrees) = -1.3 m.
  EXPECT_EQ(PlaceName([](double t) {
              return Place{6.8 * t, 0.7 * std::max(0.0, t - 4.4)};
            }),
            "keep straight");
  // 6.9 degrees to the right: d = 53 m tan(3.5 degrees) - 0.8 m = 2.4 m, of no lane change.
  EXPECT_EQ(PlaceName([](double t) {
              return Place{10.7 * t, -1.3 * std::max(0.0, t - 4.4)};
            }),
            "keep straight");
}

TEST(ActionNamesTest, TheExamplesDecideWhatTheMeanLeavesOpen) {
  const Motion bend = Turn(0.0, 60.0, std::numbers::pi / 9.0, 8.0);  // 20 degrees
  EXPECT_EQ(PlaceName(bend), "bear left");
  EXPECT_EQ(PlaceName(bend, UseOf(50, "", 0.9, "left_turn")), "left turn, wide");
  EXPECT_EQ(PlaceName(bend, UseOf(50, "", 0.9, "right_turn")), "bear left");  // contradicts
  EXPECT_EQ(PlaceName(bend, UseOf(50, "", 0.4, "left_turn")), "bear left");   // a minority
  EXPECT_EQ(PlaceName(bend, UseOf(3, "", 0.9, "left_turn")), "bear left");    // too few
  EXPECT_EQ(PlaceName(Turn(0.0, 60.0, std::numbers::pi / 7.5, 8.0),           // 24 degrees
                      UseOf(50, "", 0.7, "lane_change_left")),
            "bear left");
  EXPECT_EQ(PlaceName(Shift(12.0, 1.4), UseOf(50, "", 0.7, "lane_change_left")),
            "lane change left");
}

// 0.1, 0.5, 0.8 and 1.2 m/s^2 over five seconds.
TEST(ActionNamesTest, NamesRelativeActionsByTheSpeedTheyGainOrLose) {
  EXPECT_EQ(RelativeName(Gain(0.0, 0.0)), "keep speed");
  EXPECT_EQ(RelativeName(Gain(0.1, 0.0)), "speed up gently");
  EXPECT_EQ(RelativeName(Gain(0.5, 0.0)), "speed up");
  EXPECT_EQ(RelativeName(Gain(1.2, 0.0)), "speed up hard");
  EXPECT_EQ(RelativeName(Gain(-0.1, 0.0)), "slow down gently");
  EXPECT_EQ(RelativeName(Gain(-0.5, 0.0)), "slow down");
  EXPECT_EQ(RelativeName(Gain(-0.9, 0.0)), "brake");
  EXPECT_EQ(RelativeName(Gain(-1.4, 0.0)), "brake hard");
}

TEST(ActionNamesTest, TheSameAccelerationHasTheSameNameAtAnyHorizon) {
  for (const double horizon : {3.0, 5.0, 8.0}) {
    EXPECT_EQ(RelativeName(Gain(-0.5, 0.0), {}, horizon), "slow down") << horizon;
    EXPECT_EQ(RelativeName(Gain(0.0, 0.5), {}, horizon), "bear left") << horizon;
    EXPECT_EQ(RelativeName(Gain(0.0, -0.2), {}, horizon), "drift right") << horizon;
  }
}

// The deviation to the side is 12.5 s^2 times the acceleration: 2.5, 6.25 and 12.5 m.
TEST(ActionNamesTest, NamesRelativeActionsBySideAndReach) {
  EXPECT_EQ(RelativeName(Gain(0.0, 0.2)), "drift left");
  EXPECT_EQ(RelativeName(Gain(0.0, -0.5)), "bear right");
  EXPECT_EQ(RelativeName(Gain(0.0, 1.0)), "left turn");
  // An arc of 60 m radius at 10 m/s: 60 m (1 - cos(50 / 60)) = 20 m to the side, at the same speed.
  const Motion arc = Turn(0.0, -60.0, 1.0, 10.0);
  EXPECT_EQ(RelativeName([&](double t) {
              return Place{arc(t).x - 10.0 * t, arc(t).y};
            }),
            "right turn, tight");
  // Half a second before the end 4.5 m/s to the side and 10 - 5.4 m/s ahead: 44 degrees.
  EXPECT_EQ(RelativeName(Gain(-1.2, 1.0)), "left turn, tight, braking");
  EXPECT_EQ(RelativeName(Gain(-0.6, 1.0)), "left turn, slowing");
  EXPECT_EQ(RelativeName(Gain(0.5, -0.5)), "bear right, speeding up");
}

TEST(ActionNamesTest, TheExamplesOfARelativeActionSayWhetherItTurnsOrChangesLanes) {
  EXPECT_EQ(RelativeName(Gain(0.0, 0.5), UseOf(50, "turns_left", 0.8)), "left turn, wide");
  EXPECT_EQ(RelativeName(Gain(0.0, 0.5), UseOf(50, "turns_right", 0.8)), "bear left");
  EXPECT_EQ(RelativeName(Gain(0.0, 0.5), UseOf(9, "turns_left", 0.8)), "bear left");
  EXPECT_EQ(RelativeName(Gain(0.0, 0.2), UseOf(50, "lane_change_left", 0.6)), "lane change left");
  EXPECT_EQ(RelativeName(Gain(0.0, -0.2), UseOf(50, "lane_change_left", 0.6)), "drift right");
  EXPECT_EQ(RelativeName(Gain(0.0, 0.5), UseOf(50, "lane_change_left", 0.6)), "lane change left");
  // 12.5 m to the side are more than two lanes.
  EXPECT_EQ(RelativeName(Gain(0.0, 1.0), UseOf(50, "lane_change_left", 0.6)), "bear left");
  EXPECT_EQ(RelativeName(Gain(0.0, 1.0), UseOf(50, "keeps_speed", 0.6)), "bear left");
  // Who is slow enough stops by any loss of speed: that says more of the speed than of the action.
  EXPECT_EQ(RelativeName(Gain(-0.5, 0.0), UseOf(50, "stops", 0.9)), "slow down");
}

// A pedestrian walks at 1.4 m/s: a quarter of a vehicle's figures.
TEST(ActionNamesTest, PedestriansDoLessForTheSameName) {
  v1::ModelManifest manifest = EmptyManifest(5.0, true);
  manifest.mutable_spec()->add_target_types(v1::AGENT_TYPE_PEDESTRIAN);
  for (const Motion& deviation : {Gain(-0.12, 0.0), Gain(-0.3, 0.0), Gain(0.0, 0.05)}) {
    AddAction(manifest, [&](double t) { return Place{10.0 * t + deviation(t).x, deviation(t).y}; });
  }
  EXPECT_THAT(NameActions(manifest), ElementsAre("slow down", "slow down hard", "drift left"));
  const std::vector<v1::ActionUse> uses(3, UseOf(50, "lane_change_left", 0.9));
  EXPECT_EQ(NameActions(manifest, uses)[2], "step aside left");
}

TEST(ActionNamesTest, NumbersTellActionsOfTheSameWordsApart) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  AddAction(manifest, Straight(5.0, 0.0));
  AddAction(manifest, Straight(11.0, 0.0));
  AddAction(manifest, Straight(6.0, -1.5));
  // Of 25 m and 20 m, 5 m lead to the corner and 4 pi around it: 8 m to the side, then 7.4 and 2.4.
  AddAction(manifest, Turn(5.0, 8.0, kRight, 5.0));
  AddAction(manifest, Turn(5.0, 8.0, kRight, 4.0));
  EXPECT_THAT(NameActions(manifest),
              ElementsAre("keep straight, 5 m/s", "keep straight, 11 m/s", "stop within 12 m",
                          "left turn, tight, 15 m", "left turn, tight, 10 m"));
}

TEST(ActionNamesTest, DecimalsAreAsFewAsTellActionsApart) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  AddAction(manifest, Straight(11.1, 0.0));
  AddAction(manifest, Straight(11.3, 0.0));
  EXPECT_THAT(NameActions(manifest),
              ElementsAre("keep straight, 11.1 m/s", "keep straight, 11.3 m/s"));
  // The last second of 0.1 m/s^2 gains 0.45 m/s: "+0 m/s" would say nothing.
  v1::ModelManifest relative = EmptyManifest(5.0, true);
  for (const double gain : {0.1, 0.2}) {
    AddAction(relative, [=](double t) { return Place{10.0 * t + gain * t * t / 2.0, 0.0}; });
  }
  EXPECT_THAT(NameActions(relative),
              ElementsAre("speed up gently, +0.5 m/s", "speed up gently, +0.9 m/s"));
}

TEST(ActionNamesTest, TheOnlyEffectiveActionOfItsWordsBearsThemAlone) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  AddAction(manifest, Straight(5.0, 0.0), false);
  AddAction(manifest, Straight(11.0, 0.0));
  EXPECT_THAT(NameActions(manifest), ElementsAre("keep straight, 5 m/s", "keep straight"));
}

TEST(ActionNamesTest, ActionsThatAreNotEffectiveDoNotLengthenTheNamesOfOthers) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  AddAction(manifest, Straight(5.1, 0.0), false);
  AddAction(manifest, Straight(5.0, 0.0));
  AddAction(manifest, Straight(11.0, 0.0));
  EXPECT_THAT(NameActions(manifest), ElementsAre("keep straight, 5.1 m/s", "keep straight, 5 m/s",
                                                 "keep straight, 11 m/s"));
}

TEST(ActionNamesTest, EqualActionsAreCounted) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  for (int i = 0; i < 3; ++i) AddAction(manifest, Straight(11.0, 0.0));
  EXPECT_THAT(NameActions(manifest),
              ElementsAre("keep straight (1)", "keep straight (2)", "keep straight (3)"));
}

TEST(ActionNamesTest, NamesOfAnyActionsAreDifferentShortAndAlwaysTheSame) {
  std::mt19937 generator(7);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (const bool relative : {false, true}) {
    for (int round = 0; round < 50; ++round) {
      v1::ModelManifest manifest = EmptyManifest(5.0, relative);
      for (int k = 0; k < 60; ++k) {
        const Motion motion = Gain(3.0 * any(generator), 3.0 * any(generator) * any(generator));
        const double speed = 20.0 * any(generator);
        AddAction(manifest, [&](double t) { return Place{speed * t + motion(t).x, motion(t).y}; });
      }
      const std::vector<std::string> names = NameActions(manifest);
      EXPECT_THAT(std::set<std::string>(names.begin(), names.end()), SizeIs(60));
      EXPECT_THAT(names,
                  Each(testing::Property(&std::string::size, testing::Le(kLongestDerivedName))));
      EXPECT_EQ(NameActions(manifest), names);
    }
  }
}

TEST(ActionNamesTest, AnActionWithoutAMeanHasItsNumberForAName) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  AddAction(manifest, Straight(11.0, 0.0));
  AddAction(manifest, Straight(11.0, 0.0));
  manifest.mutable_actions(1)->clear_distribution();
  EXPECT_THAT(NameActions(manifest), ElementsAre("keep straight", "action 1"));
}

TEST(ActionNamesTest, ALabelIsShownInPlaceOfTheDerivedName) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  AddAction(manifest, Straight(11.0, 0.0));
  AddAction(manifest, Straight(0.2, 0.0));
  manifest.mutable_actions(0)->set_derived_name("cruise");
  manifest.mutable_actions(1)->set_derived_name("wait");
  manifest.mutable_actions(1)->set_label("at the light");
  CompleteActionNames(manifest);
  EXPECT_EQ(manifest.actions(0).display_name(), "cruise");
  EXPECT_EQ(manifest.actions(1).display_name(), "at the light");
  EXPECT_EQ(manifest.actions(1).derived_name(), "wait");
  EXPECT_THAT(DisplayNames(manifest), ElementsAre("cruise", "at the light"));
}

TEST(ActionNamesTest, VersionsFromBeforeThereWereNamesAreNamedByTheirMeans) {
  v1::ModelManifest manifest = EmptyManifest(5.0, false);
  AddAction(manifest, Straight(11.0, 0.0));
  manifest.mutable_actions(0)->set_label("cruise");
  AddAction(manifest, Straight(0.2, 0.0));
  CompleteActionNames(manifest);
  EXPECT_EQ(manifest.actions(0).derived_name(), "keep straight");
  EXPECT_EQ(manifest.actions(0).display_name(), "cruise");
  EXPECT_EQ(manifest.actions(1).display_name(), "stand still");
}

}  // namespace
}  // namespace maneuver::evaluation::action_names_test
