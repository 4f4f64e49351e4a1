#include "model/data/waymo/waymo_reader.h"

#include <google/protobuf/arena.h>
#include <google/protobuf/io/coded_stream.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <map>
#include <set>
#include <string>

#include "absl/strings/str_cat.h"
#include "model/data/agent_size.h"
#include "model/data/lane_links.h"
#include "model/data/recording_split.h"
#include "model/scene/scenario_validation.h"
#include "waymo_scenario.pb.h"

namespace maneuver::data {
namespace {

using google::protobuf::io::CodedInputStream;

constexpr double kMetersPerSecondPerMph = 0.44704;
constexpr int kDefaultCurrentStep = 10;  // one second of past at 10 Hz
// Ten times as many as 20 s of a thousand road users have.
constexpr int64_t kMostMessages = 2'000'000;

v1::AgentType TypeOf(const waymo::Track& track) {
  switch (track.object_type()) {
    case waymo::Track::TYPE_VEHICLE:
      return v1::AGENT_TYPE_VEHICLE;
    case waymo::Track::TYPE_PEDESTRIAN:
      return v1::AGENT_TYPE_PEDESTRIAN;
    case waymo::Track::TYPE_CYCLIST:
      return v1::AGENT_TYPE_CYCLIST;
    case waymo::Track::TYPE_OTHER:
      return v1::AGENT_TYPE_OTHER;
    case waymo::Track::TYPE_UNSET:
      break;
  }
  return v1::AGENT_TYPE_UNSPECIFIED;
}

v1::TrafficSignalState StateOf(const waymo::TrafficSignalLaneState& lane_state) {
  switch (lane_state.state()) {
    case waymo::TrafficSignalLaneState::STATE_ARROW_STOP:
    case waymo::TrafficSignalLaneState::STATE_STOP:
    case waymo::TrafficSignalLaneState::STATE_FLASHING_STOP:
      return v1::TRAFFIC_SIGNAL_STATE_STOP;
    case waymo::TrafficSignalLaneState::STATE_ARROW_CAUTION:
    case waymo::TrafficSignalLaneState::STATE_CAUTION:
    case waymo::TrafficSignalLaneState::STATE_FLASHING_CAUTION:
      return v1::TRAFFIC_SIGNAL_STATE_CAUTION;
    case waymo::TrafficSignalLaneState::STATE_ARROW_GO:
    case waymo::TrafficSignalLaneState::STATE_GO:
      return v1::TRAFFIC_SIGNAL_STATE_GO;
    case waymo::TrafficSignalLaneState::STATE_UNKNOWN:
      break;
  }
  return v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED;
}

// Returns whether a state has a usable position.
bool IsUsable(const waymo::ObjectState& state) {
  return state.valid() && std::isfinite(state.center_x()) && std::isfinite(state.center_y()) &&
         std::isfinite(state.heading()) && std::isfinite(state.velocity_x()) &&
         std::isfinite(state.velocity_y());
}

bool HasSize(const waymo::ObjectState& state) {
  return std::isfinite(state.length()) && std::isfinite(state.width()) && state.length() > 0.0f &&
         state.width() > 0.0f;
}

// Returns the size of the usable state nearest to step `current` that has one.
AgentSize SizeOf(const waymo::Track& track, int current) {
  const waymo::ObjectState* nearest = nullptr;
  int distance = 0;
  for (int i = 0; i < track.states_size(); ++i) {
    if (!IsUsable(track.states(i)) || !HasSize(track.states(i))) continue;
    if (nearest != nullptr && std::abs(i - current) >= distance) continue;
    nearest = &track.states(i);
    distance = std::abs(i - current);
  }
  if (nearest == nullptr) return TypicalSize(TypeOf(track));
  return {nearest->length(), nearest->width()};
}

void AddAgent(const waymo::Scenario& recording, const waymo::Track& track, int current,
              v1::Scenario* scenario) {
  if (std::none_of(track.states().begin(), track.states().end(), IsUsable)) return;
  const AgentSize size = SizeOf(track, current);
  v1::Agent* agent = scenario->add_agents();
  agent->set_id(track.id());
  agent->set_type(TypeOf(track));
  agent->set_length(size.length);
  agent->set_width(size.width);
  for (int i = 0; i < track.states_size(); ++i) {
    const waymo::ObjectState& state = track.states(i);
    if (!IsUsable(state)) continue;
    v1::AgentState* agent_state = agent->add_states();
    agent_state->set_time(recording.timestamps_seconds(i));
    agent_state->set_x(state.center_x());
    agent_state->set_y(state.center_y());
    agent_state->set_heading(state.heading());
    agent_state->set_velocity_x(state.velocity_x());
    agent_state->set_velocity_y(state.velocity_y());
  }
}

void AddTargets(const waymo::Scenario& recording, int current, v1::Scenario* scenario) {
  std::set<int64_t> named;
  for (const waymo::RequiredPrediction& required : recording.tracks_to_predict()) {
    const int index = required.track_index();
    if (index < 0 || index >= recording.tracks_size()) continue;
    const waymo::Track& track = recording.tracks(index);
    if (!IsUsable(track.states(current))) continue;  // absent at the prediction time
    if (named.insert(track.id()).second) scenario->add_target_ids(track.id());
  }
}

template <typename Points>
void AddFeature(int64_t id, v1::MapFeatureType type, const Points& points, double speed_limit,
                v1::Scenario* scenario) {
  v1::MapFeature feature;
  for (const waymo::MapPoint& point : points) {
    if (!std::isfinite(point.x()) || !std::isfinite(point.y())) continue;
    feature.add_x(point.x());
    feature.add_y(point.y());
  }
  if (feature.x().empty()) return;
  feature.set_id(id);
  feature.set_type(type);
  if (std::isfinite(speed_limit) && speed_limit > 0.0) feature.set_speed_limit(speed_limit);
  *scenario->add_map_features() = std::move(feature);
}

// Declares which lanes follow each other and which are neighbours. Either lane may declare that one
// follows the other.
void AddLaneLinks(const waymo::Scenario& recording, v1::Scenario* scenario) {
  std::map<int64_t, v1::MapFeature*> lanes;
  for (v1::MapFeature& feature : *scenario->mutable_map_features()) {
    if (feature.type() == v1::MAP_FEATURE_TYPE_LANE_CENTERLINE ||
        feature.type() == v1::MAP_FEATURE_TYPE_BIKE_LANE) {
      lanes.emplace(feature.id(), &feature);
    }
  }
  for (const waymo::MapFeature& feature : recording.map_features()) {
    const auto found = lanes.find(feature.id());
    if (!feature.has_lane() || found == lanes.end()) continue;
    v1::MapFeature* const lane = found->second;
    for (const int64_t id : feature.lane().exit_lanes())
      AddLaneLink(id, lane->mutable_successor_ids());
    for (const auto& neighbor : feature.lane().left_neighbors()) {
      AddLaneLink(neighbor.feature_id(), lane->mutable_left_neighbor_ids());
    }
    for (const auto& neighbor : feature.lane().right_neighbors()) {
      AddLaneLink(neighbor.feature_id(), lane->mutable_right_neighbor_ids());
    }
    for (const int64_t id : feature.lane().entry_lanes()) {
      const auto before = lanes.find(id);
      if (before == lanes.end()) continue;
      AddLaneLink(feature.id(), before->second->mutable_successor_ids());
    }
  }
}

void AddMapFeature(const waymo::MapFeature& feature, v1::Scenario* scenario) {
  const int64_t id = feature.id();
  switch (feature.feature_data_case()) {
    case waymo::MapFeature::kLane: {
      const waymo::LaneCenter& lane = feature.lane();
      const bool is_for_bicycles = lane.type() == waymo::LaneCenter::TYPE_BIKE_LANE;
      AddFeature(
          id,
          is_for_bicycles ? v1::MAP_FEATURE_TYPE_BIKE_LANE : v1::MAP_FEATURE_TYPE_LANE_CENTERLINE,
          lane.polyline(), lane.speed_limit_mph() * kMetersPerSecondPerMph, scenario);
      return;
    }
    case waymo::MapFeature::kRoadLine:
      AddFeature(id, v1::MAP_FEATURE_TYPE_ROAD_LINE, feature.road_line().polyline(), 0, scenario);
      return;
    case waymo::MapFeature::kRoadEdge:
      AddFeature(id, v1::MAP_FEATURE_TYPE_ROAD_EDGE, feature.road_edge().polyline(), 0, scenario);
      return;
    case waymo::MapFeature::kStopSign:
      if (!feature.stop_sign().has_position()) return;
      AddFeature(id, v1::MAP_FEATURE_TYPE_STOP_SIGN, std::array{feature.stop_sign().position()}, 0,
                 scenario);
      return;
    case waymo::MapFeature::kCrosswalk:
      AddFeature(id, v1::MAP_FEATURE_TYPE_CROSSWALK, feature.crosswalk().polygon(), 0, scenario);
      return;
    case waymo::MapFeature::kSpeedBump:
      AddFeature(id, v1::MAP_FEATURE_TYPE_SPEED_BUMP, feature.speed_bump().polygon(), 0, scenario);
      return;
    case waymo::MapFeature::kDriveway:
      AddFeature(id, v1::MAP_FEATURE_TYPE_DRIVEWAY, feature.driveway().polygon(), 0, scenario);
      return;
    case waymo::MapFeature::FEATURE_DATA_NOT_SET:
      return;  // a kind of feature that is newer than this schema
  }
}

void AddSignals(const waymo::Scenario& recording, v1::Scenario* scenario) {
  const int steps =
      std::min(recording.dynamic_map_states_size(), recording.timestamps_seconds_size());
  std::map<int64_t, v1::TrafficSignal> signals;  // by lane
  for (int i = 0; i < steps; ++i) {
    std::map<int64_t, v1::TrafficSignalState> shown;
    for (const auto& lane_state : recording.dynamic_map_states(i).lane_states()) {
      shown.emplace(lane_state.lane(), StateOf(lane_state));
      signals[lane_state.lane()].set_lane_id(lane_state.lane());
    }
    for (auto& [lane, signal] : signals) {
      const auto found = shown.find(lane);
      const auto state =
          found != shown.end() ? found->second : v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED;
      const bool changes =
          signal.readings().empty() || signal.readings().rbegin()->state() != state;
      if (!changes) continue;
      v1::TrafficSignalReading* reading = signal.add_readings();
      reading->set_time(recording.timestamps_seconds(i));
      reading->set_state(state);
    }
  }
  for (auto& [lane, signal] : signals) *scenario->add_traffic_signals() = std::move(signal);
}

// Counts the messages inside a recording, of which an empty one takes two bytes and in memory forty
// times as many. Returns false if the bytes are damaged or have groups, which Waymo's do not.
//   depth: of the message that `input` is in, 0 for the recording
bool CountMessages(CodedInputStream& input, int depth, int64_t* messages) {
  constexpr uint32_t kTypeMask = 7, kTypeBits = 3;
  while (const uint32_t tag = input.ReadTag()) {
    uint64_t number = 0;
    uint32_t length = 0;
    switch (tag & kTypeMask) {
      case 0:
        if (!input.ReadVarint64(&number)) return false;
        continue;
      case 1:
        if (!input.Skip(8)) return false;
        continue;
      case 2:
        if (!input.ReadVarint32(&length) || length > uint32_t{INT32_MAX}) return false;
        break;
      case 5:
        if (!input.Skip(4)) return false;
        continue;
      default:
        return false;
    }
    ++*messages;
    // Nothing else in a recording, and nothing in a state, lane, line or area, holds messages that
    // are read.
    static const std::set<uint32_t> kWithMessages = {waymo::Scenario::kTracksFieldNumber,
                                                     waymo::Scenario::kDynamicMapStatesFieldNumber,
                                                     waymo::Scenario::kMapFeaturesFieldNumber};
    if (depth > 1 || (depth == 0 && !kWithMessages.contains(tag >> kTypeBits))) {
      if (!input.Skip(static_cast<int>(length))) return false;
      continue;
    }
    const auto limit = input.PushLimit(static_cast<int>(length));
    if (!CountMessages(input, depth + 1, messages)) return false;
    input.PopLimit(limit);
  }
  return input.ConsumedEntireMessage();
}

// Checks that a recording does not become far larger in memory than it is.
absl::Status CheckSize(std::string_view serialized) {
  CodedInputStream input(reinterpret_cast<const uint8_t*>(serialized.data()),
                         static_cast<int>(serialized.size()));
  int64_t messages = 0;
  if (!CountMessages(input, 0, &messages)) {
    return absl::InvalidArgumentError("not a serialised Waymo scenario");
  }
  if (messages <= kMostMessages) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "the scenario has ", messages, " states, points and other parts; at most ", kMostMessages));
}

// Checks the recording as a whole.
absl::Status Check(const waymo::Scenario& recording) {
  if (recording.tracks().empty()) return absl::InvalidArgumentError("the scenario has no tracks");
  const auto& times = recording.timestamps_seconds();
  for (int i = 0; i < times.size(); ++i) {
    if (!std::isfinite(times[i]) || (i > 0 && times[i] <= times[i - 1])) {
      return absl::InvalidArgumentError(
          absl::StrCat("timestamps_seconds[", i, "] must be later than the one before"));
    }
  }
  if (times.empty()) return absl::InvalidArgumentError("the scenario has no timestamps");
  // Before the scenario's own check: AddSignals looks at each lane at each time.
  const scene::ScenarioLimits limits;
  if (times.size() > limits.max_states_per_agent) {
    return absl::InvalidArgumentError(absl::StrCat(
        "timestamps_seconds has ", times.size(), " times; at most ", limits.max_states_per_agent));
  }
  std::set<int64_t> lanes;
  for (const auto& shown : recording.dynamic_map_states()) {
    for (const auto& lane_state : shown.lane_states()) lanes.insert(lane_state.lane());
  }
  if (std::ssize(lanes) > limits.max_traffic_signals) {
    return absl::InvalidArgumentError(absl::StrCat("dynamic_map_states has signals of ",
                                                   lanes.size(), " lanes; at most ",
                                                   limits.max_traffic_signals));
  }
  for (int i = 0; i < recording.tracks_size(); ++i) {
    if (recording.tracks(i).states_size() != times.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat("tracks[", i, "] must have one state for each of the ", times.size(),
                       " timestamps, not ", recording.tracks(i).states_size()));
    }
  }
  if (recording.current_time_index() < 0 || recording.current_time_index() >= times.size()) {
    return absl::InvalidArgumentError("current_time_index must be one of the timestamps");
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<v1::Scenario> ParseWaymoScenario(std::string_view serialized) {
  if (absl::Status status = CheckSize(serialized); !status.ok()) return status;
  google::protobuf::Arena arena;
  auto& recording = *google::protobuf::Arena::CreateMessage<waymo::Scenario>(&arena);
  if (!recording.ParseFromArray(serialized.data(), static_cast<int>(serialized.size()))) {
    return absl::InvalidArgumentError("not a serialised Waymo scenario");
  }
  if (absl::Status status = Check(recording); !status.ok()) return status;
  const int last = recording.timestamps_seconds_size() - 1;
  const int current = recording.has_current_time_index() ? recording.current_time_index()
                                                         : std::min(kDefaultCurrentStep, last);
  v1::Scenario scenario;
  scenario.set_scenario_id(recording.scenario_id().empty() ? IdFromContent(serialized)
                                                           : recording.scenario_id());
  scenario.set_prediction_time(recording.timestamps_seconds(current));
  for (const waymo::Track& track : recording.tracks()) {
    AddAgent(recording, track, current, &scenario);
  }
  AddTargets(recording, current, &scenario);
  for (const waymo::MapFeature& feature : recording.map_features()) {
    AddMapFeature(feature, &scenario);
  }
  AddLaneLinks(recording, &scenario);
  AddSignals(recording, &scenario);
  return scenario;
}

}  // namespace maneuver::data
