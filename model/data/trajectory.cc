#include "model/data/trajectory.h"

#include <algorithm>
#include <cstddef>
#include <optional>

namespace maneuver::data {
namespace {

// Returns p_WP at time `t`, interpolated between the states on either side.
std::optional<scene::Point2> PositionAt(const v1::Agent& agent, double t, double max_gap) {
  const auto& states = agent.states();
  const auto after = std::lower_bound(
      states.begin(), states.end(), t,
      [](const v1::AgentState& state, double time) { return state.time() < time; });
  const bool has_after = after != states.end();
  const bool has_before = after != states.begin();
  const auto before = has_before ? after - 1 : after;
  if (has_after && has_before && after->time() - before->time() <= max_gap + kClockTolerance) {
    const double share = (t - before->time()) / (after->time() - before->time());
    return scene::Point2{before->x() + share * (after->x() - before->x()),
                         before->y() + share * (after->y() - before->y())};
  }
  // Next to a gap or at an end of the track, only a state at this very time counts.
  if (has_after && after->time() - t <= kClockTolerance)
    return scene::Point2{after->x(), after->y()};
  if (has_before && t - before->time() <= kClockTolerance) {
    return scene::Point2{before->x(), before->y()};
  }
  return std::nullopt;
}

}  // namespace

bool ResampleFuture(const v1::Agent& agent, double time, const scene::Pose2& X_WT,
                    std::span<const double> waypoint_times, double max_gap,
                    std::span<double> trajectory, int* missing) {
  for (size_t i = 0; i < waypoint_times.size(); ++i) {
    const std::optional<scene::Point2> p_WP = PositionAt(agent, time + waypoint_times[i], max_gap);
    if (!p_WP) {
      if (missing != nullptr) *missing = static_cast<int>(i);
      return false;
    }
    const scene::Point2 p_TP = X_WT.ToLocal(*p_WP);
    trajectory[2 * i] = p_TP.x;
    trajectory[2 * i + 1] = p_TP.y;
  }
  return true;
}

}  // namespace maneuver::data
