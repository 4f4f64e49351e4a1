// Recordings that are given by formulas: vehicles on lanes of constant curvature, so that the lane
// ahead says where a vehicle goes.

#ifndef MANEUVER_TESTS_UNIT_MODEL_LEARNING_ANALYTIC_SCENES_H_
#define MANEUVER_TESTS_UNIT_MODEL_LEARNING_ANALYTIC_SCENES_H_

#include <string>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"

namespace maneuver::learning {

// A vehicle that starts at the origin with heading 0 and follows its lane at 10 Hz.
//   curvature: 1/m, left is positive;  speed: m/s;  duration: seconds
v1::Scenario ArcRecording(const std::string& id, double curvature, double speed,
                          double duration = 8.0);

// Lanes that a fork shows.
enum class Fork { kLeft, kRight, kBoth };

// A vehicle that drives straight on for 2 s at 8 m/s and then along an arc to the left or the
// right. The map shows the lane of that arc, the one of its mirror image, or both.
//   curvature: of the arcs, 1/m, positive
v1::Scenario ForkRecording(const std::string& id, Fork lanes, bool turns_left, double curvature);

// `count` recordings over a few curvatures and speeds, differing a little.
//   duration: of each, seconds
std::vector<v1::Scenario> ArcRecordings(int count, double duration = 8.0);

// `count` recordings of a pedestrian who walks along an arc of a footway and of a vehicle that
// drives beside it.
std::vector<v1::Scenario> WalkRecordings(int count);

// `recordings`, in which up to 15 pedestrians walk about beside the vehicle: more than are read.
std::vector<v1::Scenario> AmongPedestrians(std::vector<v1::Scenario> recordings);

// Complete settings that train in seconds: 3 s horizon, 6 actions.
v1::TrainingSettings TinySettings();

// The same of the presets `lanes` and `lanes-metres`.
v1::TrainingSettings TinyLanesSettings(const std::string& preset = "lanes");

}  // namespace maneuver::learning

#endif  // MANEUVER_TESTS_UNIT_MODEL_LEARNING_ANALYTIC_SCENES_H_
