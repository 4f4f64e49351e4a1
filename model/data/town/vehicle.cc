#include "model/data/town/vehicle.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace maneuver::data::town {
namespace {

constexpr double kAheadStep = 2.0;  // metres
constexpr double kReverseSpeed = 1.7;

// Returns the smoothest step from 0 to 1 (quintic: no slope or curvature at either end), and its
// slope.
Lateral SmoothStep(double t) {
  if (t <= 0.0) return {0.0, 0.0};
  if (t >= 1.0) return {1.0, 0.0};
  return {t * t * t * (10.0 + t * (-15.0 + 6.0 * t)), 30.0 * t * t * (1.0 - t) * (1.0 - t)};
}

double TurnSign(const Lane& lane) {
  switch (lane.movement) {
    case Movement::kLeft:
      return 1.0;
    case Movement::kRight:
      return -0.5;  // close to the kerb
    case Movement::kUTurn:
      return 0.5;
    default:
      return 0.0;
  }
}

// Records what entering the lane at the head of the route looks like from outside.
void NoteEvent(const LaneNetwork& graph, Vehicle& vehicle) {
  const Lane& lane = graph.lanes[vehicle.lane()];
  const double from = vehicle.travelled - vehicle.s;
  RouteEvent event{Maneuver::kKeepLane, from - 2.0, from, from + lane.path.length()};
  switch (lane.movement) {
    case Movement::kLeft:
      event.maneuver = Maneuver::kTurnLeft;
      break;
    case Movement::kRight:
      event.maneuver = Maneuver::kTurnRight;
      break;
    case Movement::kUTurn:
      event.maneuver = Maneuver::kUTurn;
      break;
    case Movement::kRoundabout:
      event.maneuver = Maneuver::kRoundabout;
      break;
    default:
      return;
  }
  if (!vehicle.events.empty() && vehicle.events.back().maneuver == event.maneuver &&
      event.maneuver == Maneuver::kRoundabout) {
    vehicle.events.back().to = event.to;
    return;
  }
  vehicle.events.push_back(event);
}

}  // namespace

Lateral LateralAt(const Vehicle& vehicle, const Lane& lane, double s, double travelled) {
  const Driver& driver = vehicle.driver;
  if (lane.kind == LaneKind::kBay) return {};
  const double rate = 2.0 * std::numbers::pi / driver.wander_length;
  const double phase = rate * travelled + driver.wander_phase;
  Lateral result{driver.offset + driver.wander * std::sin(phase),
                 driver.wander * rate * std::cos(phase)};
  const double sign = TurnSign(lane);
  if (sign != 0.0) {
    const double x = std::numbers::pi * s / lane.path.length();
    const double sine = std::sin(x);
    const double cut = sign * driver.corner_cut;
    result.offset += cut * sine * sine;
    result.slope += cut * std::sin(2.0 * x) * std::numbers::pi / lane.path.length();
  }
  if (vehicle.change_offset != 0.0 && travelled < vehicle.change_start + vehicle.change_length) {
    const Lateral step = SmoothStep((travelled - vehicle.change_start) / vehicle.change_length);
    result.offset += vehicle.change_offset * (1.0 - step.offset);
    result.slope -= vehicle.change_offset * step.slope / vehicle.change_length;
  }
  return result;
}

PathPoint PoseAt(const Vehicle& vehicle, const Lane& lane, double s, double travelled) {
  PathPoint at = lane.path.At(s);
  const Lateral lateral = LateralAt(vehicle, lane, s, travelled);
  at.p = at.p + lateral.offset * Left(Direction(at.heading));
  const double stretch = std::max(0.2, 1.0 - at.curvature * lateral.offset);
  at.heading += std::atan(lateral.slope / stretch);
  at.curvature /= stretch;
  return at;
}

void LookAhead(const LaneNetwork& graph, Vehicle& vehicle) {
  if (vehicle.speed == 0.0 && vehicle.travelled == vehicle.looked_at) return;
  vehicle.looked_at = vehicle.travelled;
  vehicle.ahead.clear();
  const double reach = 14.0 + 2.0 * vehicle.speed + vehicle.speed * vehicle.speed / 7.0;
  size_t step = vehicle.step;
  double s = vehicle.s;
  for (double distance = 0.0; distance <= reach; distance += kAheadStep) {
    while (s > graph.lanes[vehicle.route[step].lane].path.length()) {
      s -= graph.lanes[vehicle.route[step].lane].path.length();
      if (++step >= vehicle.route.size()) return;
      s += vehicle.route[step].from;
    }
    const Lane& lane = graph.lanes[vehicle.route[step].lane];
    const PathPoint at = lane.path.At(s);
    const Lateral lateral = LateralAt(vehicle, lane, s, vehicle.travelled + distance);
    const double stretch = std::max(0.2, 1.0 - at.curvature * lateral.offset);
    const Vec2 along = Direction(at.heading);
    const Vec2 direction = along + lateral.slope / stretch * Left(along);
    double limit = lane.speed_limit * vehicle.driver.speed_factor;
    if (lane.reverse) limit = kReverseSpeed;
    const double bend = std::abs(at.curvature) / stretch;
    if (bend > 1e-4) limit = std::min(limit, std::sqrt(vehicle.driver.lateral_comfort / bend));
    vehicle.ahead.push_back(
        {distance, at.p + lateral.offset * Left(along), 1.0 / Norm(direction) * direction, limit});
    s += kAheadStep;
  }
}

double DistanceToStep(const LaneNetwork& graph, const Vehicle& vehicle, size_t step) {
  if (step <= vehicle.step) return vehicle.route[step].from - vehicle.s;
  double distance = graph.lanes[vehicle.lane()].path.length() - vehicle.s;
  for (size_t k = vehicle.step + 1; k < step; ++k) {
    distance += graph.lanes[vehicle.route[k].lane].path.length() - vehicle.route[k].from;
  }
  return distance;
}

void SetPose(const LaneNetwork& graph, bool align, Vehicle& vehicle) {
  const Lane& lane = graph.lanes[vehicle.lane()];
  vehicle.pose = PoseAt(vehicle, lane, vehicle.s, vehicle.travelled);
  vehicle.lateral = LateralAt(vehicle, lane, vehicle.s, vehicle.travelled).offset;
  const double body = vehicle.pose.heading + (lane.reverse ? std::numbers::pi : 0.0);
  if (align) vehicle.body_heading = body;
}

bool Advance(const LaneNetwork& graph, double dt, Vehicle& vehicle) {
  const double before = vehicle.speed;
  vehicle.speed = std::max(0.0, before + vehicle.acceleration * dt);
  if (vehicle.speed < 0.02 && vehicle.acceleration <= 0.0) vehicle.speed = 0.0;
  const double way = 0.5 * (before + vehicle.speed) * dt;
  if (way <= 0.0) return true;
  const PathPoint centre = graph.lanes[vehicle.lane()].path.At(vehicle.s);
  const Lateral lateral =
      LateralAt(vehicle, graph.lanes[vehicle.lane()], vehicle.s, vehicle.travelled);
  // The path driven is longer or shorter than the centreline beside it.
  const double ds = way / std::hypot(1.0 - centre.curvature * lateral.offset, lateral.slope);
  vehicle.s += ds;
  vehicle.travelled += ds;
  while (vehicle.s > graph.lanes[vehicle.lane()].path.length()) {
    vehicle.s -= graph.lanes[vehicle.lane()].path.length();
    if (vehicle.step + 1 >= vehicle.route.size()) return false;
    const bool out_of_bay = graph.lanes[vehicle.lane()].kind == LaneKind::kBay;
    ++vehicle.step;
    vehicle.s += vehicle.route[vehicle.step].from;
    vehicle.stood_at = std::numeric_limits<double>::infinity();
    NoteEvent(graph, vehicle);
    if (out_of_bay) {
      // Moves from the middle of the lane to this driver's preferred offset.
      const Lane& aisle = graph.lanes[vehicle.lane()];
      vehicle.change_offset = -LateralAt(vehicle, aisle, vehicle.s, vehicle.travelled).offset;
      vehicle.change_start = vehicle.travelled;
      vehicle.change_length = 12.0;
    }
  }
  SetPose(graph, false, vehicle);
  const bool reverse = graph.lanes[vehicle.lane()].reverse;
  const double wanted = vehicle.pose.heading + (reverse ? std::numbers::pi : 0.0);
  // The rear axle is 0.3 lengths behind the centre and moves in the direction of the body.
  const double share = reverse ? 1.0 : 1.0 - std::exp(-way / (0.3 * vehicle.length));
  vehicle.body_heading += share * WrapAngle(wanted - vehicle.body_heading);
  return true;
}

}  // namespace maneuver::data::town
