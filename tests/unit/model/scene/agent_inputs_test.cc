#include "model/scene/agent_inputs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::agent_inputs_test {
namespace {

constexpr double kTime = 3.0;
constexpr int64_t kTarget = 100;
// The numbers of an agent, repeated here on purpose.
constexpr int kX = 0, kY = 1, kNear = 2, kWithin20 = 3, kCosine = 4, kSine = 5, kVelocityX = 6,
              kVelocityY = 7, kRelativeX = 8, kSpeed = 9, kStands = 10, kSpeedChange = 11,
              kTurn = 12, kHasEarlier = 13, kLength = 14, kWidth = 15, kVehicle = 16,
              kPedestrian = 17, kCyclist = 18, kMeetingTime = 19, kMeetingNear = 20,
              kMeetingWithin8 = 21, kMeetingX = 22, kMeetingY = 23;

// An agent's motion at one time, in the target's frame.
struct Moment {
  Point2 place = {};
  Point2 velocity = {};
  double heading = 0.0;
};

// A scene and the parameters of a call. Only the agents and the target matter.
struct World {
  v1::Scenario scenario = {};
  Pose2 X_WT = {};
  double speed = 10.0;

  v1::Agent* Add(int64_t id, const Moment& present, double time = kTime,
                 v1::AgentType type = v1::AGENT_TYPE_VEHICLE) {
    v1::Agent* agent = AddAgent(&scenario, id, type, 4.0, 1.8);
    AddMoment(agent, time, present);
    return agent;
  }
  // Call it in the order of time for each agent.
  void AddMoment(v1::Agent* agent, double time, const Moment& moment) {
    const Point2 place = X_WT * moment.place;
    const Point2 velocity = Pose2(0.0, 0.0, X_WT.heading()) * moment.velocity;
    AddState(agent, time, place.x, place.y, X_WT.heading() + moment.heading);
    agent->mutable_states()->rbegin()->set_velocity_x(static_cast<float>(velocity.x));
    agent->mutable_states()->rbegin()->set_velocity_y(static_cast<float>(velocity.y));
  }
};

AgentInputs Describe(const World& world, const WorldView& view = {},
                     int version = kLatestInputsVersion) {
  AgentInputs inputs;
  inputs.values.fill(7.0F);
  DescribeAgents(world.scenario, kTime, kTarget, world.X_WT, world.speed, view, version, &inputs);
  for (size_t i = static_cast<size_t>(inputs.count * kAgentInputs); i < inputs.values.size(); ++i) {
    EXPECT_EQ(inputs.values[i], 0.0F) << "beyond the last agent";
  }
  return inputs;
}

float At(const AgentInputs& inputs, int agent, int number) {
  return inputs.values[static_cast<size_t>(agent * kAgentInputs + number)];
}

void ExpectSame(const AgentInputs& inputs, const AgentInputs& expected, double tolerance) {
  ASSERT_EQ(inputs.count, expected.count);
  for (int i = 0; i < inputs.count; ++i) {
    for (int j = 0; j < kAgentInputs; ++j) {
      EXPECT_NEAR(At(inputs, i, j), At(expected, i, j), tolerance) << i << ", number " << j;
    }
  }
}

// Agents that move at random within 70 m. Some have no current state, some no earlier one.
World RandomWorld(uint32_t seed, int agents, const Pose2& X_WT) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  World world{.X_WT = X_WT, .speed = 8.0};
  for (int i = 0; i < agents; ++i) {
    const auto type = static_cast<v1::AgentType>(i % 5);
    const auto draw = [&] {
      return Moment{{50.0 * uniform(random), 50.0 * uniform(random)},
                    {12.0 * uniform(random), 12.0 * uniform(random)},
                    std::numbers::pi * uniform(random)};
    };
    v1::Agent* const agent = world.Add(i, draw(), kTime - 0.5, type);
    if (i % 4 == 0) agent->clear_states();
    if (i % 7 != 0) world.AddMoment(agent, kTime, draw());
    agent->set_length(2.0 + uniform(random));
    agent->set_width(1.5 + uniform(random));
  }
  return world;
}

// 13 m away, 4 m/s ahead and 3 m/s to the left; it drove 2 m/s half a second ago.
TEST(AgentInputsTest, DescribesAnAgentWith24Numbers) {
  World world{.X_WT = {30.0, -20.0, 0.4}, .speed = 10.0};
  v1::Agent* const agent = world.Add(1, {{10.0, -6.0}, {0.0, 2.0}, 0.2}, kTime - 0.5);
  world.AddMoment(agent, kTime, {{12.0, -5.0}, {4.0, 3.0}, 0.3});
  const AgentInputs inputs = Describe(world);
  ASSERT_EQ(inputs.count, 1);
  // Relative to the target it moves at (-6, 3) m/s. From (12, -5) m it reaches (0.4, 0.8) m after
  // (6 * 12 + 3 * 5) / 45 s, at a right angle to (-6, 3).
  const double meeting = 87.0 / 45.0;
  const double distance = std::sqrt(0.8);
  const double expected[kAgentInputs] = {
      0.6,
      -0.25,
      std::exp(-13.0 / 5.0),
      std::exp(-13.0 / 20.0),
      std::cos(0.3),
      std::sin(0.3),
      0.4,
      0.3,
      -0.6,
      0.5,
      std::exp(-10.0),
      3.0,
      0.4,
      1.0,
      0.8,
      0.9,
      1.0,
      0.0,
      0.0,
      meeting / 4.0,
      std::exp(-distance / 2.0),
      std::exp(-distance / 8.0),
      (12.0 + 4.0 * meeting) / 20.0,
      0.8 / 20.0,
  };
  for (int i = 0; i < kAgentInputs; ++i) {
    EXPECT_NEAR(At(inputs, 0, i), expected[i], 2e-6) << "number " << i;
  }
}

TEST(AgentInputsTest, AStandingAgentBesideAStandingTargetIsClosestNow) {
  World world{.speed = 0.0};
  world.Add(1, {{3.0, 4.0}, {}, std::numbers::pi / 2.0});
  const AgentInputs inputs = Describe(world);
  EXPECT_EQ(At(inputs, 0, kStands), 1.0F);
  EXPECT_EQ(At(inputs, 0, kMeetingTime), 0.0F);
  EXPECT_NEAR(At(inputs, 0, kMeetingNear), std::exp(-2.5), 1e-6);
  EXPECT_NEAR(At(inputs, 0, kMeetingWithin8), std::exp(-0.625), 1e-6);
  EXPECT_NEAR(At(inputs, 0, kMeetingX), 0.15, 1e-6);
  EXPECT_NEAR(At(inputs, 0, kMeetingY), 0.2, 1e-6);
  EXPECT_NEAR(At(inputs, 0, kSine), 1.0, 1e-6);
}

TEST(AgentInputsTest, AnAgentThatDrivesAwayIsClosestNow) {
  World world{.speed = 5.0};
  world.Add(1, {{20.0, 0.0}, {9.0, 0.0}});
  const AgentInputs inputs = Describe(world);
  EXPECT_EQ(At(inputs, 0, kMeetingTime), 0.0F);
  EXPECT_NEAR(At(inputs, 0, kMeetingX), 1.0, 1e-6);
}

TEST(AgentInputsTest, SearchesTheClosestApproachUpTo8SecondsAhead) {
  World world{.speed = 3.0};
  world.Add(1, {{40.0, 0.0}, {2.0, 0.0}});
  const AgentInputs inputs = Describe(world);
  EXPECT_NEAR(At(inputs, 0, kMeetingTime), 2.0, 1e-6);
  EXPECT_NEAR(At(inputs, 0, kMeetingWithin8), std::exp(-32.0 / 8.0), 1e-6);
  EXPECT_NEAR(At(inputs, 0, kMeetingX), (40.0 + 8.0 * 2.0) / 20.0, 1e-6);
}

TEST(AgentInputsTest, MarksTheTypeOfAnAgent) {
  World world;
  const v1::AgentType types[] = {v1::AGENT_TYPE_VEHICLE, v1::AGENT_TYPE_PEDESTRIAN,
                                 v1::AGENT_TYPE_CYCLIST, v1::AGENT_TYPE_OTHER,
                                 v1::AGENT_TYPE_UNSPECIFIED};
  for (int i = 0; i < 5; ++i) world.Add(i, {{1.0 + i, 0.0}}, kTime, types[i]);
  const AgentInputs inputs = Describe(world);
  ASSERT_EQ(inputs.count, 5);
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(At(inputs, i, kVehicle), i == 0 ? 1.0F : 0.0F) << i;
    EXPECT_EQ(At(inputs, i, kPedestrian), i == 1 ? 1.0F : 0.0F) << i;
    EXPECT_EQ(At(inputs, i, kCyclist), i == 2 ? 1.0F : 0.0F) << i;
  }
}

TEST(AgentInputsTest, ChangesAreRelativeToTheStateNearestToHalfASecondBefore) {
  World world;
  v1::Agent* const agent = world.Add(1, {{10.0, 0.0}, {9.0, 0.0}}, kTime - 0.54);
  world.AddMoment(agent, kTime - 0.47, {{10.0, 0.0}, {6.0, 0.0}});
  world.AddMoment(agent, kTime - 0.4, {{10.0, 0.0}, {8.0, 0.0}});
  world.AddMoment(agent, kTime, {{10.0, 0.0}, {7.0, 0.0}});
  const AgentInputs inputs = Describe(world);
  EXPECT_NEAR(At(inputs, 0, kSpeedChange), 1.0, 1e-6);
  EXPECT_EQ(At(inputs, 0, kHasEarlier), 1.0F);
}

TEST(AgentInputsTest, ChangesAreZeroWithoutAStateHalfASecondBefore) {
  World world;
  v1::Agent* const agent = world.Add(1, {{10.0, 0.0}, {9.0, 0.0}, 1.0}, kTime - 0.56);
  world.AddMoment(agent, kTime - 0.44, {{10.0, 0.0}, {9.0, 0.0}, 1.0});
  world.AddMoment(agent, kTime, {{10.0, 0.0}, {7.0, 0.0}});
  const AgentInputs inputs = Describe(world);
  for (const int number : {kSpeedChange, kTurn, kHasEarlier}) {
    EXPECT_EQ(At(inputs, 0, number), 0.0F) << number;
  }
}

TEST(AgentInputsTest, AChangeOfHeadingAcrossPiIsSmall) {
  World world;
  v1::Agent* const agent = world.Add(1, {{10.0, 0.0}, {}, 3.1}, kTime - 0.5);
  world.AddMoment(agent, kTime, {{10.0, 0.0}, {}, -3.1});
  EXPECT_NEAR(At(Describe(world), 0, kTurn), (2.0 * std::numbers::pi - 6.2) / 0.25, 1e-5);
}

TEST(AgentInputsTest, ClampsNumbersToTheirBounds) {
  constexpr float kLargestFloat = std::numeric_limits<float>::max();
  World world{.speed = -500.0};
  v1::Agent* const agent = world.Add(1, {{10.0, 0.0}, {}, -3.0}, kTime - 0.5);
  world.AddMoment(agent, kTime, {{10.0, 0.0}, {}});
  agent->set_length(1e300);
  agent->set_width(1e300);
  v1::AgentState& present = *agent->mutable_states(1);
  present.set_velocity_x(kLargestFloat);
  present.set_velocity_y(-kLargestFloat);
  const AgentInputs inputs = Describe(world, {.scale = 1.1, .mirror = false});
  for (int i = 0; i < kAgentInputs; ++i) {
    EXPECT_TRUE(std::isfinite(At(inputs, 0, i))) << i;
    EXPECT_LE(std::abs(At(inputs, 0, i)), 8.0F) << i;
  }
  for (const int number : {kVelocityX, kRelativeX, kSpeed, kLength, kWidth}) {
    EXPECT_EQ(At(inputs, 0, number), 8.0F) << number;
  }
  EXPECT_EQ(At(inputs, 0, kVelocityY), -8.0F);
  EXPECT_EQ(At(inputs, 0, kSpeedChange), 4.0F);
  EXPECT_EQ(At(inputs, 0, kTurn), 4.0F);
}

TEST(AgentInputsTest, DescribesAgentsCloserThan50Metres) {
  World world;
  world.Add(1, {{30.0, 40.0}});
  world.Add(2, {{-49.99, 0.0}});
  world.Add(3, {{1e300, -1e300}});
  const AgentInputs inputs = Describe(world);
  ASSERT_EQ(inputs.count, 1);
  EXPECT_NEAR(At(inputs, 0, kX), -49.99 / 20.0, 1e-6);
}

TEST(AgentInputsTest, DoesNotDescribeTheTarget) {
  World world;
  world.Add(kTarget, {{0.0, 0.0}});
  EXPECT_EQ(Describe(world).count, 0);
  EXPECT_EQ(Describe(World()).count, 0);
}

TEST(AgentInputsTest, AnAgentGoesOnFromAStateThatIsALittleOld) {
  World world{.X_WT = {30.0, -20.0, 0.4}};
  world.Add(1, {{5.0, 1.0}, {20.0, -4.0}}, kTime - 0.125);
  world.Add(2, {{4.0, 0.0}}, kTime - 0.13);
  world.Add(3, {{3.0, 0.0}}, kTime + 0.01);
  const AgentInputs inputs = Describe(world);
  ASSERT_EQ(inputs.count, 1);
  EXPECT_NEAR(At(inputs, 0, kX), (5.0 + 0.125 * 20.0) / 20.0, 1e-5);
  EXPECT_NEAR(At(inputs, 0, kY), (1.0 - 0.125 * 4.0) / 20.0, 1e-5);
}

TEST(AgentInputsTest, InEarlierVersionsAnAgentStaysWhereAStateOfTheLast50MillisecondsIs) {
  World world;
  world.Add(1, {{5.0, 0.0}, {20.0, 0.0}}, kTime - 0.05);
  world.Add(2, {{4.0, 0.0}}, kTime - 0.06);
  world.Add(3, {{3.0, 0.0}}, kTime + 0.01);
  for (const int version : {0, 1, 2}) {
    const AgentInputs inputs = Describe(world, {}, version);
    ASSERT_EQ(inputs.count, 1);
    EXPECT_NEAR(At(inputs, 0, kX), 0.25, 1e-6);
  }
}

TEST(AgentInputsTest, ReadsNothingLater) {
  const World world = RandomWorld(4, 40, {5.0, 6.0, 0.7});
  World longer = world;
  for (v1::Agent& agent : *longer.scenario.mutable_agents()) {
    for (const double time : {0.02, 0.1, 0.5}) {
      longer.AddMoment(&agent, kTime + time, {{1.0, 1.0}, {30.0, 0.0}, 1.0});
    }
  }
  EXPECT_EQ(Describe(longer).values, Describe(world).values);
}

TEST(AgentInputsTest, DescribesTheNearestTwelveNearestFirst) {
  World world{.X_WT = {-3.0, 8.0, 2.0}};
  // 7 and 30 are coprime, so the distances 1 .. 30 m are not sorted.
  for (int i = 0; i < 30; ++i) {
    const double distance = 1.0 + 7 * i % 30;
    world.Add(i, {{distance * std::cos(i), distance * std::sin(i)}});
  }
  const AgentInputs inputs = Describe(world);
  ASSERT_EQ(inputs.count, kMostNearAgents);
  for (int i = 0; i < inputs.count; ++i) {
    EXPECT_NEAR(std::hypot(At(inputs, i, kX), At(inputs, i, kY)), (1.0 + i) / 20.0, 1e-6) << i;
  }
}

TEST(AgentInputsTest, EquallyNearAgentsKeepTheScenariosOrder) {
  World world;
  for (int i = 0; i < 15; ++i) {
    const Point2 places[] = {{3.0, 4.0}, {-4.0, 3.0}, {0.0, -5.0}};
    world.Add(i, {places[i % 3]})->set_length(0.5 * i);
  }
  const AgentInputs inputs = Describe(world);
  ASSERT_EQ(inputs.count, kMostNearAgents);
  for (int i = 0; i < inputs.count; ++i) EXPECT_NEAR(At(inputs, i, kLength), 0.1 * i, 1e-6);
}

TEST(AgentInputsTest, MovingTheWholeWorldChangesNothing) {
  const World world = RandomWorld(1, 30, {});
  ASSERT_EQ(Describe(world).count, kMostNearAgents);
  for (const Pose2& X_WT : {Pose2(4000.0, -2500.0, 1.1), Pose2(-3.0, 70.0, -2.9)}) {
    ExpectSame(Describe(RandomWorld(1, 30, X_WT)), Describe(world), 1e-5);
  }
}

// Changes the agents of a world whose target is at the origin and heads along x.
World Changed(World world, const std::function<void(v1::AgentState&)>& change, double size) {
  for (v1::Agent& agent : *world.scenario.mutable_agents()) {
    agent.set_length(size * agent.length());
    agent.set_width(size * agent.width());
    for (v1::AgentState& state : *agent.mutable_states()) change(state);
  }
  world.speed *= size;
  return world;
}

TEST(AgentInputsTest, AMirroredViewDescribesTheMirroredWorld) {
  const World world = RandomWorld(2, 30, {});
  const auto mirror = [](v1::AgentState& state) {
    state.set_y(-state.y());
    state.set_velocity_y(-state.velocity_y());
    state.set_heading(-state.heading());
  };
  const AgentInputs mirrored = Describe(world, {.scale = 1.0, .mirror = true});
  ExpectSame(mirrored, Describe(Changed(world, mirror, 1.0)), 1e-6);
  const AgentInputs plain = Describe(world);
  for (int i = 0; i < plain.count; ++i) {
    for (int j = 0; j < kAgentInputs; ++j) {
      const bool flips = j == kY || j == kSine || j == kVelocityY || j == kTurn || j == kMeetingY;
      EXPECT_EQ(At(mirrored, i, j), (flips ? -1.0F : 1.0F) * At(plain, i, j)) << j;
    }
  }
}

TEST(AgentInputsTest, AScaledViewDescribesTheScaledWorld) {
  const World world = RandomWorld(3, 8, {});
  for (const double scale : {0.8, 1.25}) {
    const auto change = [scale](v1::AgentState& state) {
      state.set_x(scale * state.x());
      state.set_y(scale * state.y());
      state.set_velocity_x(static_cast<float>(scale * state.velocity_x()));
      state.set_velocity_y(static_cast<float>(scale * state.velocity_y()));
    };
    ExpectSame(Describe(world, {.scale = scale, .mirror = false}),
               Describe(Changed(world, change, scale)), 1e-5);
  }
}

TEST(AgentInputsTest, AScaledViewReachesFiftyOfItsOwnMetres) {
  World world;
  world.Add(1, {{0.0, 45.0}});
  EXPECT_EQ(Describe(world, {.scale = 1.25, .mirror = false}).count, 0);
  world.Add(2, {{0.0, 60.0}});
  EXPECT_EQ(Describe(world, {.scale = 0.8, .mirror = false}).count, 2);
}

// Compared with a sort of all distances.
TEST(AgentInputsTest, FindsTheNearestOf400Agents) {
  const World world = RandomWorld(6, 400, {100.0, 200.0, -0.8});
  std::vector<double> distances;
  for (const v1::Agent& agent : world.scenario.agents()) {
    if (agent.states().empty() || agent.states().rbegin()->time() != kTime) continue;
    distances.push_back(
        std::hypot(agent.states().rbegin()->x() - 100.0, agent.states().rbegin()->y() - 200.0));
  }
  std::ranges::sort(distances);
  const AgentInputs inputs = Describe(world);
  ASSERT_EQ(inputs.count, kMostNearAgents);
  for (int i = 0; i < inputs.count; ++i) {
    const double distance = distances[static_cast<size_t>(i)];
    EXPECT_NEAR(At(inputs, i, kNear), std::exp(-distance / 5.0), 1e-6) << i;
    EXPECT_NEAR(At(inputs, i, kWithin20), std::exp(-distance / 20.0), 1e-6) << i;
    EXPECT_NEAR(std::hypot(At(inputs, i, kCosine), At(inputs, i, kSine)), 1.0, 1e-6) << i;
  }
}

}  // namespace
}  // namespace maneuver::scene::agent_inputs_test
