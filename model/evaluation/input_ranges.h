// Compares an input with the inputs on which a model was measured.

#ifndef MANEUVER_MODEL_EVALUATION_INPUT_RANGES_H_
#define MANEUVER_MODEL_EVALUATION_INPUT_RANGES_H_

#include <array>
#include <string>
#include <string_view>

#include "maneuver/v1/evaluation.pb.h"
#include "model/evaluation/strata.h"
#include "model/scene/pose2.h"
#include "model/scene/road_map.h"

namespace maneuver::evaluation {

// By name: EvaluationReport.input_ranges and ModelManifest.input_ranges.
using InputRanges = google::protobuf::Map<std::string, v1::ValueRange>;

// A figure of an input.
struct InputFigure {
  std::string_view name;  // in InputRanges: "speed", "agents" or "map"
  double (*value)(const StratumKeys& keys);
};

const std::array<InputFigure, 3>& InputFigures();

// Returns the number of features whose box reaches within 50 m of the target along both axes of the
// world.
int MapFeaturesNear(const scene::RoadMap& map, const scene::Pose2& X_WT);

// Widens each range so that it contains the input.
void Widen(const StratumKeys& keys, InputRanges& ranges);

// Returns whether there is a range for the figure and the input lies outside of it.
bool IsOutside(const InputFigure& figure, const StratumKeys& keys, const InputRanges& ranges);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_INPUT_RANGES_H_
