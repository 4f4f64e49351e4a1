#include "model/scene/scene_warnings.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/scene/target_frame.h"

namespace maneuver::scene {
namespace {

// Velocities are compared with positions over at most this long, and at least the other, seconds.
constexpr double kLongestComparison = 1.0 + kSameTime;
constexpr double kShortestComparison = 0.2 - kSameTime;
// Velocities may differ from those of the positions by either, m/s and relative.
constexpr double kSpeedMargin = 4.0;
constexpr double kSpeedRatio = 0.5;
// A vehicle or cyclist that moves faster than this keeps to its heading within 60 degrees, or
// reverses up to the second speed, m/s.
constexpr double kDrivingSpeed = 3.0;
constexpr double kReversingSpeed = 10.0;
constexpr double kLargestDriftCosine = 0.5;

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

// Returns the squared distance of a point from a box, square metres; 0 inside.
double SquaredDistance(const Box& box, double x, double y) {
  const double dx = std::max({box.low_x - x, 0.0, x - box.high_x});
  const double dy = std::max({box.low_y - y, 0.0, y - box.high_y});
  return dx * dx + dy * dy;
}

class WarningSearch {
 public:
  WarningSearch(const v1::Scenario& scenario, const RoadMap& map, double tolerance,
                const SceneWarningLimits& limits)
      : scenario_(scenario),
        map_(map),
        tolerance_(tolerance),
        limits_(limits),
        sorted_targets_(scenario.target_ids().begin(), scenario.target_ids().end()) {
    std::ranges::sort(sorted_targets_);
  }

  std::vector<FieldViolation> Find() {
    for (const Box& box : map_.boxes()) whole_map_ = whole_map_ ? whole_map_->With(box) : box;
    for (int a = 0; a < scenario_.agents_size() && !full(); ++a) CheckAgent(a);
    if (!full()) CheckSignals();
    return std::move(found_);
  }

 private:
  bool full() const { return static_cast<int>(found_.size()) >= limits_.max_warnings; }

  void Warn(std::string field, std::string description) {
    if (!full()) found_.push_back({std::move(field), std::move(description)});
  }

  // Warns about a field of a state.
  void WarnState(int agent, int state, const char* field, std::string description) {
    Warn(absl::StrCat("agents[", agent, "].states[", state, "].", field),
         absl::StrCat("agent ", scenario_.agents(agent).id(), " ", std::move(description)));
  }

  bool IsTarget(int64_t id) const { return std::ranges::binary_search(sorted_targets_, id); }

  double MaxSpeed(v1::AgentType type) const {
    if (type == v1::AGENT_TYPE_PEDESTRIAN) return limits_.max_pedestrian_speed;
    if (type == v1::AGENT_TYPE_CYCLIST) return limits_.max_cyclist_speed;
    return limits_.max_vehicle_speed;
  }

  void CheckAgent(int a) {
    const v1::Agent& agent = scenario_.agents(a);
    const double now = scenario_.prediction_time();
    const int latest = FindState(agent, now, tolerance_, now + kSameTime);
    if (latest < 0) return;
    const v1::AgentState& state = agent.states(latest);
    CheckSize(a, agent);
    if (std::abs(state.heading()) > limits_.max_heading) {
      WarnState(a, latest, "heading",
                absl::StrFormat("has a heading of %g rad, which is %.0f turns; headings are in "
                                "radians, not in degrees",
                                state.heading(), std::abs(state.heading()) * kDegrees / 360.0));
    }
    const double vx = state.velocity_x();
    const double vy = state.velocity_y();
    const double max_speed = MaxSpeed(agent.type());
    if (vx * vx + vy * vy > max_speed * max_speed) {
      WarnState(a, latest, FasterAxis(state),
                absl::StrFormat("moves at %.0f m/s, and one of its type reaches %g m/s at most; "
                                "velocities are in metres per second",
                                std::hypot(vx, vy), max_speed));
    }
    const bool target = IsTarget(agent.id());
    CheckDistance(a, latest, target);
    if (target) CheckTargetMotion(a, latest);
  }

  static const char* FasterAxis(const v1::AgentState& state) {
    return std::abs(state.velocity_y()) > std::abs(state.velocity_x()) ? "velocity_y"
                                                                       : "velocity_x";
  }

  void CheckSize(int a, const v1::Agent& agent) {
    const auto check = [&](const char* field, double size, double limit) {
      if (size <= limit) return;
      Warn(absl::StrCat("agents[", a, "].", field),
           absl::StrFormat("agent %d has a %s of %g m; sizes are in metres", agent.id(), field,
                           size));
    };
    check("length", agent.length(), limits_.max_length);
    check("width", agent.width(), limits_.max_width);
    if (agent.type() == v1::AGENT_TYPE_VEHICLE &&
        agent.width() > limits_.max_vehicle_width * agent.length()) {
      Warn(absl::StrCat("agents[", a, "].width"),
           absl::StrFormat("vehicle %d has a width of %g m and a length of %g m; the length is "
                           "along the heading",
                           agent.id(), agent.width(), agent.length()));
    }
  }

  void CheckDistance(int a, int s, bool target) {
    if (!whole_map_) return;
    const v1::AgentState& state = scenario_.agents(a).states(s);
    const double limit = target ? limits_.max_target_distance : limits_.max_agent_distance;
    double nearest = SquaredDistance(*whole_map_, state.x(), state.y());
    if (target && nearest <= limit * limit) {
      nearest = std::numeric_limits<double>::infinity();
      for (const Box& box : map_.boxes()) {
        nearest = std::min(nearest, SquaredDistance(box, state.x(), state.y()));
        if (nearest <= limit * limit) break;
      }
    }
    if (nearest <= limit * limit) return;
    WarnState(a, s, "x",
              absl::StrFormat("is %.0f m away from the map at (%.1f, %.1f) m; agents and map share "
                              "one frame",
                              std::sqrt(nearest), state.x(), state.y()));
  }

  void CheckTargetMotion(int a, int latest) {
    const v1::Agent& agent = scenario_.agents(a);
    const v1::AgentState& state = agent.states(latest);
    if (latest > 0 && state.time() - agent.states(latest - 1).time() > limits_.max_gap) {
      WarnState(a, latest, "time",
                absl::StrFormat("has its latest two states %g s apart, so none is left of the "
                                "second before; times are in seconds",
                                state.time() - agent.states(latest - 1).time()));
    }
    CheckVelocity(a, latest);
    if (agent.type() == v1::AGENT_TYPE_PEDESTRIAN || agent.type() == v1::AGENT_TYPE_OTHER) return;
    const double speed = std::hypot(state.velocity_x(), state.velocity_y());
    if (speed < kDrivingSpeed) return;
    const double forward = (state.velocity_x() * std::cos(state.heading()) +
                            state.velocity_y() * std::sin(state.heading())) /
                           speed;
    if (forward >= kLargestDriftCosine) return;
    if (forward <= -kLargestDriftCosine && speed <= kReversingSpeed) return;
    WarnState(
        a, latest, "heading",
        absl::StrFormat("moves at %.1f m/s, %.0f degrees off its heading of %g rad; headings "
                        "are in radians, counter-clockwise from +x",
                        speed, std::acos(std::max(forward, -1.0)) * kDegrees, state.heading()));
  }

  // Compares the mean of two velocities with how far the positions are apart.
  void CheckVelocity(int a, int latest) {
    const v1::Agent& agent = scenario_.agents(a);
    const v1::AgentState& end = agent.states(latest);
    int first = latest;
    while (first > 0 && end.time() - agent.states(first - 1).time() <= kLongestComparison) --first;
    const v1::AgentState& begin = agent.states(first);
    const double seconds = end.time() - begin.time();
    if (seconds < kShortestComparison) return;
    const double moved_x = (end.x() - begin.x()) / seconds;
    const double moved_y = (end.y() - begin.y()) / seconds;
    const double vx = 0.5 * (static_cast<double>(begin.velocity_x()) + end.velocity_x());
    const double vy = 0.5 * (static_cast<double>(begin.velocity_y()) + end.velocity_y());
    const double off = std::hypot(vx - moved_x, vy - moved_y);
    const double larger = std::max(std::hypot(vx, vy), std::hypot(moved_x, moved_y));
    if (off <= std::max(kSpeedMargin, kSpeedRatio * larger)) return;
    WarnState(a, latest,
              std::abs(vy - moved_y) > std::abs(vx - moved_x) ? "velocity_y" : "velocity_x",
              absl::StrFormat("has a velocity of (%.1f, %.1f) m/s, but its positions of the %.1f s "
                              "before move at (%.1f, %.1f) m/s; velocities are in metres per "
                              "second, in the frame of the positions",
                              vx, vy, seconds, moved_x, moved_y));
  }

  // Warns once, about the first signal whose lane is missing, and counts the others.
  void CheckSignals() {
    std::vector<std::pair<int64_t, int>> wanted;  // lane, signal
    for (int i = 0; i < scenario_.traffic_signals_size(); ++i) {
      wanted.emplace_back(scenario_.traffic_signals(i).lane_id(), i);
    }
    if (wanted.empty()) return;
    std::sort(wanted.begin(), wanted.end());
    std::vector<bool> missing(wanted.size(), true);  // by signal
    for (const v1::MapFeature& feature : map_.features()) {
      if (feature.type() != v1::MAP_FEATURE_TYPE_LANE_CENTERLINE &&
          feature.type() != v1::MAP_FEATURE_TYPE_BIKE_LANE) {
        continue;
      }
      const std::pair<int64_t, int> from{feature.id(), 0};
      for (auto each = std::lower_bound(wanted.begin(), wanted.end(), from);
           each != wanted.end() && each->first == feature.id(); ++each) {
        missing[static_cast<size_t>(each->second)] = false;
      }
    }
    const auto first = std::find(missing.begin(), missing.end(), true);
    if (first == missing.end()) return;
    const int signal = static_cast<int>(first - missing.begin());
    const auto others = std::count(first + 1, missing.end(), true);
    Warn(absl::StrCat("traffic_signals[", signal, "].lane_id"),
         absl::StrCat("the map has no lane ", scenario_.traffic_signals(signal).lane_id(),
                      others > 0 ? absl::StrCat(", nor those of ", others, " more signals") : "",
                      "; a signal names the lane centreline that it controls"));
  }

  const v1::Scenario& scenario_;
  const RoadMap& map_;
  const double tolerance_;
  const SceneWarningLimits& limits_;
  std::vector<int64_t> sorted_targets_;
  std::optional<Box> whole_map_;
  std::vector<FieldViolation> found_;
};

}  // namespace

std::vector<FieldViolation> FindSceneWarnings(const v1::Scenario& scenario, const RoadMap& map,
                                              double tolerance, const SceneWarningLimits& limits) {
  return WarningSearch(scenario, map, tolerance, limits).Find();
}

}  // namespace maneuver::scene
