#include "model/data/town/right_of_way.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace maneuver::data::town {
namespace {

constexpr double kFar = 70.0;         // metres; vehicles further away are not given way to
constexpr double kHardBraking = 3.2;  // metres per second squared

// Returns the seconds to cover `distance` metres from `speed`, accelerating briskly to at most
// `top`.
double TimeToGo(double distance, double speed, double top) {
  if (distance <= 0.0) return 0.0;
  constexpr double kPace = 1.5;
  const double until_top = std::max(0.0, (top * top - speed * speed) / (2.0 * kPace));
  if (distance < until_top) {
    return (std::sqrt(speed * speed + 2.0 * kPace * distance) - speed) / kPace;
  }
  const double reached = std::max(speed, top);
  return (reached - speed) / kPace + (distance - until_top) / reached;
}

// Returns another vehicle's position relative to the start of the lane at `step` of its route,
// metres.
double PositionOnStep(const LaneNetwork& graph, const Vehicle& other, size_t step) {
  if (step >= other.step) return other.route[step].from - DistanceToStep(graph, other, step);
  double position = other.s - other.route[other.step].from;
  for (size_t k = step; k < other.step; ++k) {
    position += graph.lanes[other.route[k].lane].path.length();
  }
  return position;
}

bool LightIs(const Place& place, const Lane& lane, double time, Light light) {
  return !lane.gate || lane.gate->kind != GateKind::kSignal ||
         place.signals.At(lane.gate->signal_group, time) == light;
}

struct Approach {
  double enter = 0.0;  // seconds until the vehicle's front reaches the conflict
  double clear = 0.0;  // seconds until its rear has left it
  double rank = 0.0;
};

// Returns whether `other` is in the way at a conflict.
bool InTheWay(const Place& place, const Vehicle& vehicle, const Vehicle& other,
              const Conflict& conflict, const Gate& gate, const Approach& mine, double time) {
  const Lane& lane = place.graph.lanes[conflict.lane];
  const bool parked = other.admitted == 0 && place.graph.lanes[other.lane()].kind == LaneKind::kBay;
  if (parked) return false;
  for (size_t step = other.step > 3 ? other.step - 3 : 0; step < other.route.size(); ++step) {
    if (other.route[step].lane != conflict.lane) continue;
    const double position = PositionOnStep(place.graph, other, step);
    const double front = conflict.lane_from - position - 0.5 * other.length;
    const double rear = conflict.lane_to - position + 0.5 * other.length;
    if (rear < -0.5) continue;
    const double arrives = front / std::max(other.speed, lane.gate ? 3.0 : 2.0);
    const double margin = conflict.merge ? vehicle.driver.patience : 1.5;
    if (!lane.gate) {
      if (front > kFar) continue;
      if (arrives < std::max(mine.clear + margin, vehicle.driver.patience)) return true;
      continue;
    }
    const bool let_in = other.admitted >= step || other.step >= step;
    if (let_in) {
      // It is leaving and will be gone in time.
      const bool leaves_first = front < 0.0 && other.speed > 2.5 && other.acceleration > -0.5 &&
                                rear / other.speed + 0.8 < mine.enter && !conflict.merge;
      if (!leaves_first) return true;
      continue;
    }
    if (lane.gate->rank < gate.rank || front > kFar) continue;
    if (lane.gate->rank == gate.rank) {
      const bool came_first = other.stood_at < vehicle.stood_at ||
                              (other.stood_at == vehicle.stood_at && other.id < vehicle.id);
      if (gate.kind == GateKind::kAllWayStop && std::isfinite(other.stood_at) && came_first) {
        return true;
      }
      continue;
    }
    if (!LightIs(place, lane, time, Light::kGreen)) continue;
    if (arrives < std::max(mine.clear + 2.0, vehicle.driver.patience)) return true;
  }
  return false;
}

bool CrosswalkTaken(const Lane& lane, std::span<const Pedestrian> walkers) {
  for (const Pedestrian& walker : walkers) {
    if (!walker.on_road) continue;
    const Vec2 soon = walker.p + 2.0 * walker.speed * Direction(walker.heading);
    for (double s = 0.0; s <= lane.path.length(); s += 1.5) {
      const Vec2 p = lane.path.At(s).p;
      if (Norm(p - walker.p) < 2.6 || Norm(p - soon) < 2.2) return true;
    }
  }
  return false;
}

bool ExitBlocked(std::span<const Vehicle> vehicles, const Vehicle& vehicle, size_t step) {
  if (step + 1 >= vehicle.route.size()) return false;
  const RouteStep& exit = vehicle.route[step + 1];
  return std::any_of(vehicles.begin(), vehicles.end(), [&](const Vehicle& other) {
    if (other.id == vehicle.id || other.lane() != exit.lane || other.speed > 2.5) return false;
    const double room = other.s - exit.from - 0.5 * other.length;
    return room > -0.5 * other.length && room < vehicle.length + 3.0;
  });
}

}  // namespace

double DistanceToGate(const LaneNetwork& graph, const Vehicle& vehicle, size_t step) {
  return DistanceToStep(graph, vehicle, step) - 0.5 * vehicle.length - kLineGap;
}

bool MayEnter(const Place& place, std::span<const Vehicle> vehicles,
              std::span<const Pedestrian> walkers, const Vehicle& vehicle, size_t step,
              double time) {
  const Lane& lane = place.graph.lanes[vehicle.route[step].lane];
  const Gate& gate = *lane.gate;
  if (!LightIs(place, lane, time, Light::kGreen)) return false;
  if (gate.kind == GateKind::kStopSign || gate.kind == GateKind::kAllWayStop) {
    if (time < vehicle.stood_at + 0.8) return false;
  }
  if (ExitBlocked(vehicles, vehicle, step)) return false;
  if (CrosswalkTaken(lane, walkers)) return false;
  const double distance = DistanceToStep(place.graph, vehicle, step) - 0.5 * vehicle.length;
  const double top = lane.movement == Movement::kStraight || lane.movement == Movement::kAlong
                         ? std::max(5.0, 0.8 * lane.speed_limit)
                         : 4.5;
  return std::none_of(gate.conflicts.begin(), gate.conflicts.end(), [&](const Conflict& conflict) {
    Approach mine;
    mine.enter = TimeToGo(distance + conflict.from, vehicle.speed, top);
    mine.clear = TimeToGo(distance + conflict.to + vehicle.length, vehicle.speed, top);
    return std::any_of(vehicles.begin(), vehicles.end(), [&](const Vehicle& other) {
      return other.id != vehicle.id && InTheWay(place, vehicle, other, conflict, gate, mine, time);
    });
  });
}

bool MustStopAfterAll(const Place& place, const Vehicle& vehicle, size_t step, double time) {
  const Lane& lane = place.graph.lanes[vehicle.route[step].lane];
  if (LightIs(place, lane, time, Light::kGreen)) return false;
  const double distance = DistanceToGate(place.graph, vehicle, step);
  return distance > 0.0 && distance > vehicle.speed * vehicle.speed / (2.0 * kHardBraking);
}

}  // namespace maneuver::data::town
