#include "tests/unit/model/scene/plain_lane_paths.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <tuple>

namespace maneuver::scene {
namespace {

constexpr double kDistances[] = {2.5, 5, 7.5, 10, 15, 20, 25, 30, 40, 50, 65, 80, 100};

double Distance(Point2 a, Point2 b) { return std::hypot(a.x - b.x, a.y - b.y); }
double Angle(Point2 from, Point2 to) { return std::atan2(to.y - from.y, to.x - from.x); }
Point2 Between(Point2 a, Point2 b, double share) {
  return {a.x + share * (b.x - a.x), a.y + share * (b.y - a.y)};
}

// Returns the distance to the nearest of the straights between points, the first and the last of
// which go on for 1 km.
double DistanceToLine(Point2 point, std::vector<Point2> line) {
  const auto beyond = [](Point2 from, Point2 to) {
    return Between(from, to, 1.0 + 1000.0 / Distance(from, to));
  };
  line.front() = beyond(line[1], line[0]);
  line.back() = beyond(line[line.size() - 2], line.back());
  double nearest = 1e9;
  for (size_t i = 1; i < line.size(); ++i) {
    const Pose2 start(line[i - 1].x, line[i - 1].y, Angle(line[i - 1], line[i]));
    const Point2 local = start.ToLocal(point);
    const double length = Distance(line[i - 1], line[i]);
    nearest = std::min(nearest, std::hypot(local.x - std::clamp(local.x, 0.0, length), local.y));
  }
  return nearest;
}

struct PlainLane {
  int64_t id = 0;
  double speed_limit = 0.0;
  std::vector<Point2> points;
  std::vector<size_t> next;

  double StartAngle() const { return Angle(points[0], points[1]); }
  double EndAngle() const { return Angle(points[points.size() - 2], points.back()); }
  double Length() const {
    double length = 0.0;
    for (size_t i = 1; i < points.size(); ++i) length += Distance(points[i - 1], points[i]);
    return length;
  }
};

std::vector<PlainLane> LanesOf(const v1::Scenario& scenario) {
  std::vector<PlainLane> lanes;
  std::vector<const v1::MapFeature*> features;
  for (const v1::MapFeature& feature : scenario.map_features()) {
    if (feature.type() != v1::MAP_FEATURE_TYPE_LANE_CENTERLINE) continue;
    PlainLane lane{feature.id(), feature.speed_limit(), {}, {}};
    for (int i = 0; i < feature.x_size(); ++i) {
      const Point2 point{feature.x(i), feature.y(i)};
      if (lane.points.empty() || Distance(lane.points.back(), point) > 1e-3) {
        lane.points.push_back(point);
      }
    }
    if (lane.points.size() < 2) continue;
    lanes.push_back(lane);
    features.push_back(&feature);
  }
  for (size_t i = 0; i < lanes.size(); ++i) {
    for (const int64_t id : features[i]->successor_ids()) {
      for (size_t j = 0; j < lanes.size(); ++j) {
        if (lanes[j].id != id || id == 0) continue;
        if (j != i && Distance(lanes[j].points[0], lanes[i].points.back()) <= 5.0) {
          lanes[i].next.push_back(j);
        }
        break;
      }
    }
    if (!lanes[i].next.empty()) continue;
    for (size_t j = 0; j < lanes.size(); ++j) {
      if (j != i && Distance(lanes[j].points[0], lanes[i].points.back()) <= 0.6 &&
          std::cos(lanes[j].StartAngle() - lanes[i].EndAngle()) > 0.8) {
        lanes[i].next.push_back(j);
      }
    }
  }
  return lanes;
}

// A straight piece of a path, from arc length s to arc length e.
struct Straight {
  Point2 from, to;
  double s, e;
  double heading;
  bool is_gap;
};

struct PlainPath {
  std::vector<size_t> lanes;
  std::vector<double> starts;  // arc length where each lane begins
  std::vector<Straight> straights;
  double end = 0.0;

  PlainPath(const std::vector<PlainLane>& all, const std::vector<size_t>& chosen) : lanes(chosen) {
    for (size_t k = 0; k < chosen.size(); ++k) {
      const PlainLane& lane = all[chosen[k]];
      if (k > 0) {
        const Point2 before = all[chosen[k - 1]].points.back();
        const double gap = Distance(before, lane.points[0]);
        if (gap > 1e-3) {
          straights.push_back({before, lane.points[0], end, end + gap, lane.StartAngle(), true});
          end += gap;
        }
      }
      starts.push_back(end);
      for (size_t i = 1; i < lane.points.size(); ++i) {
        const double length = Distance(lane.points[i - 1], lane.points[i]);
        straights.push_back({lane.points[i - 1], lane.points[i], end, end + length,
                             Angle(lane.points[i - 1], lane.points[i]), false});
        end += length;
      }
    }
  }

  std::pair<Point2, double> At(double s) const {
    const Straight* on = &straights.front();
    for (const Straight& straight : straights) {
      if (straight.s <= s) on = &straight;
    }
    return {Between(on->from, on->to, (s - on->s) / (on->e - on->s)), on->heading};
  }

  // Returns distance, arc length and heading of the place between `from` and `to` nearest to a
  // point.
  std::optional<std::tuple<double, double, double>> Nearest(Point2 point, double from,
                                                            double to) const {
    std::optional<std::tuple<double, double, double>> nearest;
    for (const Straight& straight : straights) {
      const double first = std::max(from, straight.s);
      const double last = std::min(to, straight.e);
      if (straight.is_gap || first > last) continue;
      // The foot of the perpendicular, by the law of cosines.
      const double a = Distance(straight.from, point);
      const double b = Distance(straight.to, point);
      const double c = straight.e - straight.s;
      const double foot = std::clamp(straight.s + (a * a - b * b + c * c) / (2.0 * c), first, last);
      const double distance =
          Distance(point, Between(straight.from, straight.to, (foot - straight.s) / c));
      if (!nearest || distance < std::get<0>(*nearest) - 1e-9) {
        nearest = {distance, foot, straight.heading};
      }
    }
    return nearest;
  }
};

struct PlainStart {
  double cost;
  size_t lane;
  double foot;
  double offset;
  double heading;
};

std::vector<PlainStart> StartsOf(const std::vector<PlainLane>& lanes, const Pose2& X_WT) {
  const Point2 target{X_WT.x(), X_WT.y()};
  std::vector<PlainStart> starts;
  for (size_t k = 0; k < lanes.size(); ++k) {
    std::optional<PlainStart> best;
    double s = 0.0;
    for (size_t i = 1; i < lanes[k].points.size(); ++i) {
      const Point2 a = lanes[k].points[i - 1];
      const Point2 b = lanes[k].points[i];
      const double length = Distance(a, b);
      const double heading = Angle(a, b);
      const Point2 local = Pose2(a.x, a.y, heading).ToLocal(target);
      const double along = std::clamp(local.x, 0.0, length);
      const double distance = std::hypot(local.x - along, local.y);
      const double turn = std::abs(std::remainder(heading - X_WT.heading(), 2.0 * M_PI));
      if (distance < 5.0 && turn < M_PI / 3.0) {
        const double cost = distance + 4.0 * (1.0 - std::cos(turn));
        if (!best || cost < best->cost) best = {cost, k, s + along, local.y, heading};
      }
      s += length;
    }
    if (best) starts.push_back(*best);
  }
  std::stable_sort(starts.begin(), starts.end(),
                   [](const auto& a, const auto& b) { return a.cost < b.cost; });
  if (starts.size() > 6) starts.resize(6);
  return starts;
}

std::vector<std::vector<size_t>> ChainsOf(const std::vector<PlainLane>& lanes,
                                          const PlainStart& start) {
  std::vector<std::vector<size_t>> complete;
  std::deque<std::vector<size_t>> open = {{start.lane}};
  for (int extensions = 0; !open.empty() && complete.size() < 5; ++extensions) {
    const std::vector<size_t> chain = open.front();
    open.pop_front();
    std::vector<size_t> ways;
    for (const size_t next : lanes[chain.back()].next) {
      if (std::find(chain.begin(), chain.end(), next) == chain.end() && ways.size() < 4) {
        ways.push_back(next);
      }
    }
    const double length = PlainPath(lanes, chain).end - start.foot;
    if (ways.empty() || length >= 110.0 || extensions >= 128) {
      complete.push_back(chain);
      continue;
    }
    for (const size_t next : ways) {
      open.push_back(chain);
      open.back().push_back(next);
    }
  }
  return complete;
}

// Returns the agent's state at a time; nothing if it has none.
std::optional<v1::AgentState> StateAt(const v1::Agent& agent, double time, int inputs_version) {
  const double oldest = inputs_version < 3 ? 0.05 : 0.125;
  std::optional<v1::AgentState> found;
  for (const v1::AgentState& state : agent.states()) {
    if (state.time() <= time + 1e-6 && state.time() >= time - oldest - 1e-6) found = state;
  }
  if (found && inputs_version >= 3) {
    found->set_x(found->x() + (time - found->time()) * found->velocity_x());
    found->set_y(found->y() + (time - found->time()) * found->velocity_y());
  }
  return found;
}

std::map<int64_t, v1::TrafficSignalState> SignalsAt(const v1::Scenario& scenario, double time) {
  // From the most to the least restrictive.
  const std::vector<v1::TrafficSignalState> order = {
      v1::TRAFFIC_SIGNAL_STATE_STOP, v1::TRAFFIC_SIGNAL_STATE_CAUTION, v1::TRAFFIC_SIGNAL_STATE_GO,
      v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED};
  const auto rank = [&](v1::TrafficSignalState state) {
    return std::find(order.begin(), order.end(), state) - order.begin();
  };
  std::map<int64_t, v1::TrafficSignalState> states;
  for (const v1::TrafficSignal& signal : scenario.traffic_signals()) {
    std::optional<v1::TrafficSignalState> shown;
    for (const v1::TrafficSignalReading& reading : signal.readings()) {
      if (reading.time() <= time + 1e-6) shown = reading.state();
    }
    if (!shown || signal.lane_id() == 0) continue;
    const auto known = states.find(signal.lane_id());
    if (known == states.end() || rank(*shown) < rank(known->second)) {
      states[signal.lane_id()] = *shown;
    }
  }
  return states;
}

void AddLeader(const v1::Scenario& scenario, double time, int64_t target_id, double speed,
               const PlainPath& path, double foot, int inputs_version, std::vector<double>* row) {
  double own_length = 0.0;
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.id() == target_id) own_length = agent.length();
  }
  double first = 1e9;
  double gap = 100.0;
  double along = 0.0;
  bool exists = false;
  for (const v1::Agent& agent : scenario.agents()) {
    const auto state = StateAt(agent, time, inputs_version);
    if (!state || agent.id() == target_id) continue;
    const auto nearest = path.Nearest({state->x(), state->y()}, foot - 1.0, foot + 80.0);
    if (!nearest) continue;
    const auto [distance, s, heading] = *nearest;
    if (distance >= 1.8 || s <= foot + 1.5 || s >= first) continue;
    first = s;
    exists = true;
    gap = s - foot - 0.5 * agent.length() - 0.5 * own_length;
    const double velocity = std::hypot(state->velocity_x(), state->velocity_y());
    along = velocity * std::cos(std::atan2(state->velocity_y(), state->velocity_x()) - heading);
  }
  row->push_back(exists);
  row->push_back(gap / 30.0);
  row->push_back(along / 10.0);
  row->push_back(exists ? (along - speed) / 10.0 : 0.0);
  row->push_back(exists ? std::exp(-std::max(gap, 0.0) / 15.0) : 0.0);
}

// The distance that is written as 0.
double NothingAt(int inputs_version) { return inputs_version < 3 ? 0.0 : 100.0; }

void AddSignal(const v1::Scenario& scenario, double time, const std::vector<PlainLane>& lanes,
               const PlainPath& path, double foot, int inputs_version, std::vector<double>* row) {
  const auto states = SignalsAt(scenario, time);
  int column = -1;
  double distance = 100.0;
  for (size_t k = 0; k < path.lanes.size() && column < 0; ++k) {
    const auto found = states.find(lanes[path.lanes[k]].id);
    if (path.starts[k] - foot <= -3.0 || found == states.end()) continue;
    column = found->second;  // unspecified, stop, caution, go: 0 to 3
    distance = path.starts[k] - foot;
  }
  for (int i = 0; i < 4; ++i) row->push_back(i == column);
  row->push_back((distance - NothingAt(inputs_version)) / 30.0);
  for (const int light : {1, 2}) {
    row->push_back(column == light ? std::exp(-std::max(distance, 0.0) / 15.0) : 0.0);
  }
}

void AddStopSign(const v1::Scenario& scenario, const PlainPath& path, double foot,
                 int inputs_version, std::vector<double>* row) {
  std::optional<double> first;
  for (const v1::MapFeature& feature : scenario.map_features()) {
    if (feature.type() != v1::MAP_FEATURE_TYPE_STOP_SIGN) continue;
    const auto nearest = path.Nearest({feature.x(0), feature.y(0)}, foot - 1.0, foot + 80.0);
    if (!nearest || std::get<0>(*nearest) >= 7.0) continue;
    const double s = std::get<1>(*nearest) - foot;
    if (!first || s < *first) first = s;
  }
  row->push_back(first.has_value());
  row->push_back((first.value_or(100.0) - NothingAt(inputs_version)) / 30.0);
  row->push_back(first ? std::exp(-std::abs(*first) / 10.0) : 0.0);
}

}  // namespace

std::vector<std::vector<double>> PlainLanePaths(const v1::Scenario& scenario, double time,
                                                int64_t target_id, const Pose2& X_WT, double speed,
                                                int inputs_version) {
  const std::vector<PlainLane> lanes = LanesOf(scenario);
  std::vector<std::vector<double>> rows;
  std::vector<std::vector<Point2>> known;
  for (const PlainStart& start : StartsOf(lanes, X_WT)) {
    for (const std::vector<size_t>& chain : ChainsOf(lanes, start)) {
      if (rows.size() == 6) break;
      const PlainPath path(lanes, chain);
      std::vector<Point2> points;
      for (const double distance : kDistances) {
        points.push_back(X_WT.ToLocal(path.At(start.foot + distance).first));
      }
      const bool is_known = std::any_of(known.begin(), known.end(), [&](const auto& other) {
        double farthest = 0.0;
        for (size_t i = 0; i < points.size(); ++i) {
          farthest = std::max(farthest, inputs_version < 2 ? Distance(points[i], other[i])
                                                           : DistanceToLine(points[i], other));
        }
        return farthest < 1.5;
      });
      if (is_known) continue;
      known.push_back(points);
      std::vector<double> row;
      for (size_t i = 0; i < points.size(); ++i) {
        row.push_back(points[i].x / std::max(kDistances[i], 5.0));
        row.push_back(points[i].y / std::max(kDistances[i], 5.0));
      }
      for (const double distance : kDistances) {
        row.push_back(std::cos(path.At(start.foot + distance).second - X_WT.heading()));
      }
      for (const double distance : kDistances) {
        row.push_back(std::sin(path.At(start.foot + distance).second - X_WT.heading()));
      }
      for (int t = 1; t <= 5; ++t) {
        const double ahead = std::max(speed, 0.0) * t;
        const Point2 place = X_WT.ToLocal(path.At(start.foot + ahead).first);
        row.push_back((place.x - ahead) / 10.0);
        row.push_back(place.y / 10.0);
      }
      row.push_back(start.offset);
      row.push_back(std::sin(X_WT.heading() - start.heading));
      row.push_back(std::cos(X_WT.heading() - start.heading));
      row.push_back(std::min(path.end - start.foot, 110.0) / 50.0);
      row.push_back(start.cost / 3.0);
      row.push_back(rows.empty());
      row.push_back(lanes[start.lane].speed_limit / 15.0);
      AddLeader(scenario, time, target_id, speed, path, start.foot, inputs_version, &row);
      AddSignal(scenario, time, lanes, path, start.foot, inputs_version, &row);
      AddStopSign(scenario, path, start.foot, inputs_version, &row);
      rows.push_back(row);
    }
  }
  return rows;
}

}  // namespace maneuver::scene
