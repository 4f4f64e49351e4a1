#include "model/scene/agent_inputs.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "model/scene/target_frame.h"

namespace maneuver::scene {
namespace {

constexpr double kAgentReach = 50.0;         // metres, between the centres
constexpr double kAgentChangeTime = 0.5;     // seconds, over which changes are read
constexpr double kEarlierTolerance = 0.05;   // seconds, of the state before
constexpr double kLatestMeeting = 8.0;       // seconds
constexpr double kLeastSquaredSpeed = 1e-6;  // m^2/s^2; slower agents do not come nearer
constexpr double kLargestAgentNumber = 8.0;  // of positions, velocities and sizes
constexpr double kLargestAgentChange = 4.0;  // of changes

struct NearAgent {
  double squared_distance;  // recorded world, square metres
  const v1::Agent* agent;
  PresentState present;
};

// Keeps the nearest agents of those that are offered, in ascending order of their distance.
class NearestAgents {
 public:
  // Of equally near agents, the one that was offered first comes first.
  void Offer(const NearAgent& offered) {
    size_t place = count_;
    while (place > 0 && offered.squared_distance < agents_[place - 1].squared_distance) --place;
    if (place == agents_.size()) return;
    count_ = std::min(count_ + 1, agents_.size());
    for (size_t i = count_ - 1; i > place; --i) agents_[i] = agents_[i - 1];
    agents_[place] = offered;
  }
  size_t count() const { return count_; }
  const NearAgent& operator[](size_t i) const { return agents_[i]; }

 private:
  std::array<NearAgent, kMostNearAgents> agents_{};
  size_t count_ = 0;
};

NearestAgents FindNearestAgents(const v1::Scenario& scenario, double time, int64_t target_id,
                                const Pose2& X_WT, double reach, int inputs_version) {
  NearestAgents nearest;
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.id() == target_id) continue;
    const auto present = PresentOf(agent, time, OthersTolerance(inputs_version), inputs_version);
    if (!present) continue;
    const double dx = present->position.x - X_WT.x();
    const double dy = present->position.y - X_WT.y();
    const double squared_distance = dx * dx + dy * dy;
    if (squared_distance < reach * reach) nearest.Offer({squared_distance, &agent, *present});
  }
  return nearest;
}

// Returns the agent's state about half a second before `present`, or nullptr.
const v1::AgentState* FindEarlierState(const v1::Agent& agent, const v1::AgentState& present) {
  const int index =
      FindState(agent, present.time() - kAgentChangeTime, kEarlierTolerance, present.time());
  return index < 0 ? nullptr : &agent.states(index);
}

double SpeedOf(const v1::AgentState& state) {
  return std::hypot(double{state.velocity_x()}, double{state.velocity_y()});
}

// Returns the turn from one heading to another, radians, within -pi .. pi.
double TurnBetween(double from, double to) {
  return std::remainder(to - from, 2.0 * std::numbers::pi);
}

// Writes the numbers of agents, one agent after the other.
class AgentWriter {
 public:
  AgentWriter(const Pose2& X_WT, double speed, const WorldView& view, float* values)
      : X_WT_(X_WT),
        scale_(view.scale),
        left_(view.mirror ? -1.0 : 1.0),
        speed_(view.scale * speed),
        next_(values) {}

  void Write(const v1::Agent& agent, const PresentState& present) {
    const v1::AgentState& state = *present.state;
    const Point2 position = InView(X_WT_.ToLocal(present.position));
    const Point2 velocity =
        InView(Pose2(0.0, 0.0, X_WT_.heading()).ToLocal({state.velocity_x(), state.velocity_y()}));
    WritePose(position, left_ * TurnBetween(X_WT_.heading(), state.heading()));
    WriteVelocity(velocity, scale_ * SpeedOf(state));
    WriteChange(state, FindEarlierState(agent, state));
    WriteBox(agent);
    WriteMeeting(position, velocity);
  }

 private:
  // Maps from the target's frame in the recorded world to that frame in the view's world.
  Point2 InView(const Point2& point) const { return {scale_ * point.x, left_ * scale_ * point.y}; }

  void Add(double value) { *next_++ = static_cast<float>(value); }
  void AddHeld(double value, double largest = kLargestAgentNumber) {
    Add(std::clamp(value, -largest, largest));
  }

  void WritePose(const Point2& position, double heading) {
    const double distance = std::hypot(position.x, position.y);
    AddHeld(position.x / 20.0);
    AddHeld(position.y / 20.0);
    Add(std::exp(-distance / 5.0));
    Add(std::exp(-distance / 20.0));
    Add(std::cos(heading));
    Add(std::sin(heading));
  }

  void WriteVelocity(const Point2& velocity, double agent_speed) {
    AddHeld(velocity.x / 10.0);
    AddHeld(velocity.y / 10.0);
    AddHeld((velocity.x - speed_) / 10.0);
    AddHeld(agent_speed / 10.0);
    Add(std::exp(-agent_speed / 0.5));
  }

  void WriteChange(const v1::AgentState& state, const v1::AgentState* earlier) {
    const v1::AgentState& from = earlier == nullptr ? state : *earlier;
    AddHeld(scale_ * (SpeedOf(state) - SpeedOf(from)), kLargestAgentChange);
    AddHeld(left_ * TurnBetween(from.heading(), state.heading()) / 0.25, kLargestAgentChange);
    Add(earlier == nullptr ? 0.0 : 1.0);
  }

  void WriteBox(const v1::Agent& agent) {
    AddHeld(scale_ * agent.length() / 5.0);
    AddHeld(scale_ * agent.width() / 2.0);
    for (const v1::AgentType type :
         {v1::AGENT_TYPE_VEHICLE, v1::AGENT_TYPE_PEDESTRIAN, v1::AGENT_TYPE_CYCLIST}) {
      Add(agent.type() == type ? 1.0 : 0.0);
    }
  }

  // Writes when and where agent and target are closest to each other.
  void WriteMeeting(const Point2& position, const Point2& velocity) {
    const Point2 relative{velocity.x - speed_, velocity.y};
    const double squared = relative.x * relative.x + relative.y * relative.y;
    const double approach = -(position.x * relative.x + position.y * relative.y);
    const double time =
        squared > kLeastSquaredSpeed ? std::clamp(approach / squared, 0.0, kLatestMeeting) : 0.0;
    const double distance =
        std::hypot(position.x + time * relative.x, position.y + time * relative.y);
    Add(time / 4.0);
    Add(std::exp(-distance / 2.0));
    Add(std::exp(-distance / 8.0));
    AddHeld((position.x + time * velocity.x) / 20.0);
    AddHeld((position.y + time * velocity.y) / 20.0);
  }

  const Pose2 X_WT_;
  const double scale_;
  const double left_;   // -1 in a mirror
  const double speed_;  // the target's, in the view's world, m/s
  float* next_;
};

}  // namespace

void DescribeAgents(const v1::Scenario& scenario, double time, int64_t target_id, const Pose2& X_WT,
                    double speed, const WorldView& view, int inputs_version, AgentInputs* inputs) {
  assert(view.scale > 0.0);
  const NearestAgents nearest =
      FindNearestAgents(scenario, time, target_id, X_WT, kAgentReach / view.scale, inputs_version);
  inputs->count = static_cast<int>(nearest.count());
  inputs->values.fill(0.0F);
  AgentWriter writer(X_WT, speed, view, inputs->values.data());
  for (size_t i = 0; i < nearest.count(); ++i) writer.Write(*nearest[i].agent, nearest[i].present);
}

}  // namespace maneuver::scene
