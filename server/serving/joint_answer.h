// Combines the actions of a scenario's targets, once all of them are described.

#ifndef MANEUVER_SERVER_SERVING_JOINT_ANSWER_H_
#define MANEUVER_SERVER_SERVING_JOINT_ANSWER_H_

#include <cstddef>
#include <span>
#include <vector>

#include "model/inference/action_model.h"
#include "server/serving/prediction_call.h"

namespace maneuver::serving {

// Returns the scenarios of `targets`, in their order.
std::vector<TargetRange> ScenariosOf(std::span<const Target> targets);

// Finds combinations of the actions of the targets in `range` that have no error, and describes
// those of their actions that are not described yet. If this makes an answer invalid
// (answer_check.h), its target gets that error, and the others are combined without it.
//   waypoint_interval: seconds between the waypoints of the session's model
//   answers: of `targets`, as DescribeTarget left them
JointAnswer CombineTargets(const DescribeActions& question, std::span<const Target> targets,
                           const TargetRange& range, double waypoint_interval,
                           inference::InferenceSession& session, std::span<TargetAnswer> answers);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_JOINT_ANSWER_H_
