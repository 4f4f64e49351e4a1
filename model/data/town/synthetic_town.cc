#include "model/data/town/synthetic_town.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "model/data/town/maneuvers.h"
#include "model/data/town/random.h"
#include "model/data/town/sensor_model.h"
#include "model/data/town/simulated_place.h"
#include "model/data/town/targets.h"

namespace maneuver::data::town {
namespace {

constexpr uint64_t kSensorStream = 2;
constexpr int kMostAgents = 45;          // of a recording of kUsualDuration, or a shorter one
constexpr double kUsualDuration = 20.0;  // seconds
constexpr int kFirstMapFeature = 1;

// The pose of a place's frame in the world.
struct Placement {
  Vec2 origin;
  double heading = 0.0;

  Vec2 ToWorld(Vec2 p) const {
    const Vec2 axis = Direction(heading);
    return origin + p.x * axis + p.y * Left(axis);
  }
  Vec2 Turned(Vec2 v) const { return ToWorld(v) - origin; }
};

int64_t LaneFeatureId(int lane) { return kFirstMapFeature + lane; }

void AddPoint(const Placement& placement, Vec2 p, v1::MapFeature& feature) {
  const Vec2 world = placement.ToWorld(p);
  feature.add_x(world.x);
  feature.add_y(world.y);
}

// Declares a lane's successors and neighbours. Bays are left out, as in real maps.
void WriteLinks(const Place& place, const Lane& lane, v1::MapFeature& feature) {
  const auto is_mapped = [&](int i) {
    return i >= 0 && place.graph.lanes[static_cast<size_t>(i)].kind != LaneKind::kBay;
  };
  for (const LaneLink& link : lane.next) {
    // A lane that is joined beyond its start is not a successor: successors are followed from their
    // start.
    if (is_mapped(link.lane) && link.at == 0.0) feature.add_successor_ids(LaneFeatureId(link.lane));
  }
  if (is_mapped(lane.left)) feature.add_left_neighbor_ids(LaneFeatureId(lane.left));
  if (is_mapped(lane.right)) feature.add_right_neighbor_ids(LaneFeatureId(lane.right));
}

void WriteLanes(const Place& place, const Placement& placement, v1::Scenario& scenario) {
  for (size_t i = 0; i < place.graph.lanes.size(); ++i) {
    const Lane& lane = place.graph.lanes[i];
    if (lane.kind == LaneKind::kBay) continue;  // maps have no bays
    v1::MapFeature& feature = *scenario.add_map_features();
    feature.set_id(LaneFeatureId(static_cast<int>(i)));
    feature.set_type(lane.kind == LaneKind::kBike ? v1::MAP_FEATURE_TYPE_BIKE_LANE
                                                  : v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
    feature.set_speed_limit(lane.speed_limit);
    WriteLinks(place, lane, feature);
    double bend = 0.0;
    for (const PathPoint& point : lane.path.points())
      bend = std::max(bend, std::abs(point.curvature));
    const double step = bend > 0.02 ? 1.5 : 4.0;
    const int n = std::max(1, static_cast<int>(std::ceil(lane.path.length() / step)));
    for (int k = 0; k <= n; ++k)
      AddPoint(placement, lane.path.At(lane.path.length() * k / n).p, feature);
  }
}

v1::MapFeatureType TypeOf(DecorationKind kind) {
  switch (kind) {
    case DecorationKind::kRoadLine:
      return v1::MAP_FEATURE_TYPE_ROAD_LINE;
    case DecorationKind::kRoadEdge:
      return v1::MAP_FEATURE_TYPE_ROAD_EDGE;
    case DecorationKind::kCrosswalk:
      return v1::MAP_FEATURE_TYPE_CROSSWALK;
    case DecorationKind::kStopLine:
      return v1::MAP_FEATURE_TYPE_STOP_LINE;
    case DecorationKind::kSpeedBump:
      return v1::MAP_FEATURE_TYPE_SPEED_BUMP;
    case DecorationKind::kDriveway:
      return v1::MAP_FEATURE_TYPE_DRIVEWAY;
    case DecorationKind::kStopSign:
      return v1::MAP_FEATURE_TYPE_STOP_SIGN;
  }
  return v1::MAP_FEATURE_TYPE_UNSPECIFIED;
}

void WriteDecorations(const Place& place, const Placement& placement, v1::Scenario& scenario) {
  int64_t id = LaneFeatureId(static_cast<int>(place.graph.lanes.size()));
  for (const Decoration& decoration : place.decorations) {
    v1::MapFeature& feature = *scenario.add_map_features();
    feature.set_id(id++);
    feature.set_type(TypeOf(decoration.kind));
    for (const Vec2 p : decoration.points) AddPoint(placement, p, feature);
  }
}

v1::TrafficSignalState StateOf(Light light) {
  switch (light) {
    case Light::kGreen:
      return v1::TRAFFIC_SIGNAL_STATE_GO;
    case Light::kYellow:
      return v1::TRAFFIC_SIGNAL_STATE_CAUTION;
    case Light::kRed:
      return v1::TRAFFIC_SIGNAL_STATE_STOP;
  }
  return v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED;
}

void WriteSignals(const Place& place, const TownOptions& options, v1::Scenario& scenario) {
  for (size_t i = 0; i < place.graph.lanes.size(); ++i) {
    const Lane& lane = place.graph.lanes[i];
    if (!lane.gate || lane.gate->kind != GateKind::kSignal) continue;
    v1::TrafficSignal& signal = *scenario.add_traffic_signals();
    signal.set_lane_id(LaneFeatureId(static_cast<int>(i)));
    const int frames = static_cast<int>(options.duration / options.frame_interval + 1e-9);
    for (int frame = 0; frame <= frames; ++frame) {
      const double time = frame * options.frame_interval;
      const v1::TrafficSignalState state = StateOf(place.signals.At(lane.gate->signal_group, time));
      const int n = signal.readings_size();
      if (n > 0 && signal.readings(n - 1).state() == state) continue;
      v1::TrafficSignalReading& reading = *signal.add_readings();
      reading.set_time(time);
      reading.set_state(state);
    }
  }
}

v1::AgentType TypeOf(RoadUser kind) {
  switch (kind) {
    case RoadUser::kVehicle:
      return v1::AGENT_TYPE_VEHICLE;
    case RoadUser::kPedestrian:
      return v1::AGENT_TYPE_PEDESTRIAN;
    case RoadUser::kCyclist:
      return v1::AGENT_TYPE_CYCLIST;
  }
  return v1::AGENT_TYPE_UNSPECIFIED;
}

void WriteAgent(const Track& track, const Sighting& sighting, const Placement& placement,
                v1::Scenario& scenario) {
  v1::Agent& agent = *scenario.add_agents();
  agent.set_id(track.id);
  agent.set_type(TypeOf(track.kind));
  agent.set_length(track.length);
  agent.set_width(track.width);
  for (const TrackPoint& point : sighting.reported) {
    v1::AgentState& state = *agent.add_states();
    const Vec2 p = placement.ToWorld(point.p);
    const Vec2 v = placement.Turned(point.velocity);
    state.set_time(point.time);
    state.set_x(p.x);
    state.set_y(p.y);
    state.set_heading(static_cast<float>(WrapAngle(point.heading + placement.heading)));
    state.set_velocity_x(static_cast<float>(v.x));
    state.set_velocity_y(static_cast<float>(v.y));
  }
}

void WriteManeuvers(const Track& track, const Sighting& sighting, TownRecording& recording) {
  for (const ManeuverInterval& interval : RecordManeuvers(track)) {
    const double start = std::max(interval.start, sighting.first);
    const double end = std::min(interval.end, sighting.last);
    if (start >= end) continue;
    v1::ManeuverAnnotation& annotation = recording.maneuvers.emplace_back();
    annotation.set_scenario_id(recording.scenario.scenario_id());
    annotation.set_agent_id(track.id);
    annotation.set_start_time(start);
    annotation.set_end_time(end);
    annotation.set_maneuver(std::string(ManeuverName(interval.maneuver)));
  }
}

}  // namespace

TownRecording GenerateRecording(const TownOptions& options, int index) {
  const SimulatedPlace simulated = SimulatePlace(options, index);
  Random random(options.seed, static_cast<uint64_t>(index), kSensorStream);
  const Placement placement{
      .origin = {random.Uniform(-3000.0, 3000.0), random.Uniform(-3000.0, 3000.0)},
      .heading = random.Uniform(-std::numbers::pi, std::numbers::pi)};
  TownRecording recording;
  v1::Scenario& scenario = recording.scenario;
  scenario.set_scenario_id("town-" + std::to_string(options.seed) + "-" + std::to_string(index));
  WriteLanes(simulated.place, placement, scenario);
  WriteDecorations(simulated.place, placement, scenario);
  WriteSignals(simulated.place, options, scenario);

  SensorModel sensor;
  sensor.radius = simulated.place.sensed_radius;
  // Tracks are in the order in which vehicles came: a longer recording needs more to reach its end.
  const double most_agents = kMostAgents * std::max(1.0, options.duration / kUsualDuration);
  for (const Track& track : simulated.tracks) {
    if (scenario.agents_size() >= most_agents) break;
    const std::optional<Sighting> sighting = Observe(sensor, track, options.frame_interval, random);
    if (!sighting) continue;
    WriteAgent(track, *sighting, placement, scenario);
    if (track.kind == RoadUser::kVehicle) WriteManeuvers(track, *sighting, recording);
  }
  ChooseTargets(options, recording);
  return recording;
}

}  // namespace maneuver::data::town
