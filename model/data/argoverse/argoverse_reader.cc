#include "model/data/argoverse/argoverse_reader.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "model/data/agent_size.h"
#include "model/data/argoverse/motion_fit.h"
#include "model/data/quoted_text.h"
#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"
#include "model/scene/pose2.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data {
namespace {

using scene::Point2;

constexpr std::array<const char*, 6> kColumns = {"TIMESTAMP", "TRACK_ID", "OBJECT_TYPE",
                                                 "X",         "Y",        "CITY_NAME"};
constexpr size_t kObserved = 20;       // times up to the prediction
constexpr double kFrame = 0.1;         // seconds
constexpr double kMoves = 1.0;         // m/s at which the velocity gives the heading
constexpr double kStride = 0.45;       // seconds over which an agent must have moved
constexpr double kLeastStride = 0.25;  // metres by which
constexpr double kLaneReach = 5.0;     // metres
constexpr double kBlock = 600.0;       // seconds of a drive that make one recording

struct Fix {
  double time = 0.0;
  Point2 position;
};

struct Track {
  std::string type;
  std::vector<Fix> fixes;
};

struct Sequence {
  std::string city;
  double first = 0.0;                    // TIMESTAMP
  std::vector<double> times;             // each once, increasing, from the first on
  std::vector<std::string> track_order;  // by first row
  std::map<std::string, Track> tracks;   // by TRACK_ID
};

absl::Status RowError(int64_t row, const std::string& problem) {
  return absl::InvalidArgumentError(absl::StrCat("row ", row, ": ", problem));
}

std::vector<std::string> Fields(absl::string_view line) {
  std::vector<std::string> fields;
  for (const absl::string_view field : absl::StrSplit(line, ',')) {
    fields.emplace_back(absl::StripAsciiWhitespace(field));
  }
  return fields;
}

// Returns where each of kColumns is in the header.
absl::StatusOr<std::array<size_t, kColumns.size()>> ReadHeader(absl::string_view line) {
  const std::vector<std::string> names = Fields(line);
  std::array<size_t, kColumns.size()> places{};
  for (size_t i = 0; i < kColumns.size(); ++i) {
    const auto found = std::find(names.begin(), names.end(), kColumns[i]);
    if (found == names.end()) {
      return absl::InvalidArgumentError(absl::StrCat("no sequence of Argoverse 1: its first line ",
                                                     QuotedText({line.data(), line.size()}),
                                                     " lacks the column ", kColumns[i]));
    }
    places[i] = static_cast<size_t>(found - names.begin());
  }
  return places;
}

absl::Status ReadNumber(const std::string& text, const char* column, double most, int64_t row,
                        double* number) {
  if (!absl::SimpleAtod(text, number)) {
    return RowError(row, absl::StrCat(column, " ", QuotedText(text), " is not a number"));
  }
  if (!(std::abs(*number) <= most)) {
    return RowError(row, absl::StrCat(column, " ", QuotedText(text), " must lie within ", -most,
                                      " and ", most));
  }
  return absl::OkStatus();
}

absl::Status AddRow(const std::array<std::string, kColumns.size()>& fields, int64_t row,
                    Sequence* sequence) {
  const auto& [timestamp, track_id, type, x, y, city] = fields;
  const scene::ScenarioLimits limits;
  Fix fix;
  absl::Status status = ReadNumber(timestamp, kColumns[0], limits.max_time, row, &fix.time);
  if (!status.ok()) return status;
  status = ReadNumber(x, kColumns[3], limits.max_coordinate, row, &fix.position.x);
  if (!status.ok()) return status;
  status = ReadNumber(y, kColumns[4], limits.max_coordinate, row, &fix.position.y);
  if (!status.ok()) return status;
  if (track_id.empty()) return RowError(row, "TRACK_ID is empty");
  if (type != "AV" && type != "AGENT" && type != "OTHERS") {
    return RowError(row,
                    absl::StrCat("OBJECT_TYPE ", QuotedText(type), " must be AV, AGENT or OTHERS"));
  }
  if (city.empty()) return RowError(row, "CITY_NAME is empty");
  if (sequence->city.empty()) sequence->city = city;
  if (sequence->city != city) {
    return RowError(row, absl::StrCat("CITY_NAME ", QuotedText(city), " differs from ",
                                      QuotedText(sequence->city), " before"));
  }
  const auto [track, is_new] = sequence->tracks.try_emplace(track_id);
  if (is_new) {
    track->second.type = type;
    sequence->track_order.push_back(track_id);
    if (std::ssize(sequence->tracks) > limits.max_agents) {
      return RowError(row, absl::StrCat("more than ", limits.max_agents, " tracks"));
    }
  } else if (track->second.type != type) {
    return RowError(
        row, absl::StrCat("OBJECT_TYPE ", QuotedText(type), " of track ", QuotedText(track_id),
                          " was ", track->second.type, " before"));
  }
  if (std::ssize(track->second.fixes) == limits.max_states_per_agent) {
    return RowError(row, absl::StrCat("track ", QuotedText(track_id), " has more than ",
                                      limits.max_states_per_agent, " rows"));
  }
  track->second.fixes.push_back(fix);
  return absl::OkStatus();
}

absl::StatusOr<Sequence> ReadRows(std::string_view csv) {
  Sequence sequence;
  std::optional<std::array<size_t, kColumns.size()>> places;
  int64_t row = 0;
  for (absl::string_view line : absl::StrSplit(absl::string_view(csv.data(), csv.size()), '\n')) {
    ++row;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() && places) continue;
    if (!places) {
      const auto header = ReadHeader(line);
      if (!header.ok()) return header.status();
      places = *header;
      continue;
    }
    std::vector<std::string> all = Fields(line);
    std::array<std::string, kColumns.size()> fields;
    for (size_t i = 0; i < kColumns.size(); ++i) {
      if ((*places)[i] >= all.size()) {
        return RowError(
            row, absl::StrCat(kColumns[i], " is missing: the row has ", all.size(), " fields"));
      }
      fields[i] = all[(*places)[i]];
    }
    const absl::Status status = AddRow(fields, row, &sequence);
    if (!status.ok()) return status;
  }
  if (sequence.tracks.empty()) return absl::InvalidArgumentError("the sequence has no rows");
  return sequence;
}

// Sorts each track by time, and makes times count from the first.
absl::Status Order(Sequence* sequence) {
  std::set<double> times;
  for (auto& [id, track] : sequence->tracks) {
    std::sort(track.fixes.begin(), track.fixes.end(),
              [](const Fix& a, const Fix& b) { return a.time < b.time; });
    for (size_t i = 0; i < track.fixes.size(); ++i) {
      if (i > 0 && track.fixes[i].time == track.fixes[i - 1].time) {
        return absl::InvalidArgumentError(absl::StrCat("TRACK_ID ", QuotedText(id),
                                                       " has two rows with one TIMESTAMP, ",
                                                       track.fixes[i].time));
      }
      times.insert(track.fixes[i].time);
    }
  }
  sequence->first = *times.begin();
  for (const double time : times) sequence->times.push_back(time - sequence->first);
  for (auto& [id, track] : sequence->tracks) {
    for (Fix& fix : track.fixes) fix.time -= sequence->first;
  }
  return absl::OkStatus();
}

v1::Agent AgentOf(const std::string& id, const Track& track) {
  v1::Agent agent;
  agent.set_id(AgentId(id));
  agent.set_type(track.type == "OTHERS" ? v1::AGENT_TYPE_UNSPECIFIED : v1::AGENT_TYPE_VEHICLE);
  const AgentSize size = TypicalSize(v1::AGENT_TYPE_VEHICLE);
  agent.set_length(size.length);
  agent.set_width(size.width);
  std::vector<double> times;
  std::vector<Point2> positions;
  for (const Fix& fix : track.fixes) {
    times.push_back(fix.time);
    positions.push_back(fix.position);
  }
  const std::vector<Point2> velocities = FitVelocities(times, positions);
  for (size_t i = 0; i < times.size(); ++i) {
    v1::AgentState* state = agent.add_states();
    state->set_time(times[i]);
    state->set_x(positions[i].x);
    state->set_y(positions[i].y);
    state->set_velocity_x(static_cast<float>(velocities[i].x));
    state->set_velocity_y(static_cast<float>(velocities[i].y));
  }
  return agent;
}

// Returns the direction of a state's velocity, unless it is slower than kMoves, or the agent did
// not move that way in the last half second: the fit overshoots where a car stops abruptly.
std::optional<double> DirectionAt(const v1::Agent& agent, int i) {
  const v1::AgentState& state = agent.states(i);
  if (std::hypot(state.velocity_x(), state.velocity_y()) < kMoves) return std::nullopt;
  int before = i;
  while (before > 0 && state.time() - agent.states(before).time() < kStride) --before;
  // At the beginning, the half second ahead.
  int after = i;
  while (before == 0 && after + 1 < agent.states_size() &&
         agent.states(after).time() - agent.states(0).time() < kStride) {
    ++after;
  }
  const double along = (agent.states(after).x() - agent.states(before).x()) * state.velocity_x() +
                       (agent.states(after).y() - agent.states(before).y()) * state.velocity_y();
  if (along < kLeastStride * std::hypot(state.velocity_x(), state.velocity_y())) {
    return std::nullopt;
  }
  return std::atan2(state.velocity_y(), state.velocity_x());
}

// Sets the headings of an agent whose velocities are known.
void SetHeadings(const v1::Scenario& scenario, v1::Agent* agent) {
  std::vector<std::optional<double>> directions;
  for (int i = 0; i < agent->states_size(); ++i) directions.push_back(DirectionAt(*agent, i));
  const auto first =
      std::find_if(directions.begin(), directions.end(), [](const auto& each) { return !!each; });
  const Point2 place = {agent->states(0).x(), agent->states(0).y()};
  double heading =
      first != directions.end() ? **first : LaneHeadingAt(scenario, place, kLaneReach, 0.0);
  for (int i = 0; i < agent->states_size(); ++i) {
    heading = directions[static_cast<size_t>(i)].value_or(heading);
    agent->mutable_states(i)->set_heading(static_cast<float>(heading));
  }
}

}  // namespace

absl::StatusOr<v1::Scenario> ParseArgoverse(std::string_view csv, const std::string& name,
                                            const CityMaps* maps) {
  absl::StatusOr<Sequence> sequence = ReadRows(csv);
  if (!sequence.ok()) return sequence.status();
  const absl::Status ordered = Order(&*sequence);
  if (!ordered.ok()) return ordered;
  v1::Scenario scenario;
  scenario.set_prediction_time(sequence->times[std::min(kObserved, sequence->times.size()) - 1]);
  int named = 0;  // tracks that are the AGENT
  std::vector<Point2> path;
  for (const std::string& id : sequence->track_order) {
    const Track& track = sequence->tracks.at(id);
    *scenario.add_agents() = AgentOf(id, track);
    if (track.type == "AGENT") {
      ++named;
      scenario.add_target_ids(scenario.agents().rbegin()->id());
    }
    if (track.type == "OTHERS") continue;
    for (const Fix& fix : track.fixes) path.push_back(fix.position);
  }
  if (named != 1) {
    return absl::InvalidArgumentError(
        absl::StrCat("OBJECT_TYPE: one track must be the AGENT, not ", named));
  }
  if (scene::ValidateTarget(scenario, 0, kFrame / 2.0)) scenario.clear_target_ids();
  if (maps != nullptr) {
    const auto map = maps->find(sequence->city);
    if (map == maps->end()) {
      return absl::InvalidArgumentError(
          absl::StrCat("CITY_NAME: there is no map of ", QuotedText(sequence->city)));
    }
    map->second.AddNear(path, &scenario);
  }
  for (v1::Agent& agent : *scenario.mutable_agents()) SetHeadings(scenario, &agent);
  scenario.set_scenario_id(PartId(
      absl::StrCat(sequence->city, "-", static_cast<int64_t>(std::floor(sequence->first / kBlock))),
      name));
  return scenario;
}

}  // namespace maneuver::data
