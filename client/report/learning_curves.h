// The learning curves of a training: what it reported at the end of each epoch.

#ifndef MANEUVER_CLIENT_REPORT_LEARNING_CURVES_H_
#define MANEUVER_CLIENT_REPORT_LEARNING_CURVES_H_

#include <map>
#include <span>
#include <string>
#include <vector>

#include "maneuver/v1/training_service.pb.h"

namespace maneuver::report {

// The epochs of one phase, in order. Each has its epoch_report.
struct LearningPhase {
  std::string name;  // "joint"
  std::vector<v1::JobProgress> epochs;
};

// Returns the phases in the order in which they began. Skips events without an epoch_report. If an
// interrupted epoch was reported again, uses its last report.
std::vector<LearningPhase> LearningPhases(std::span<const v1::JobProgress> events);

// Returns the figures of an epoch about the mixture and the actions, by name: "effective_actions",
// "action_perplexity", "mutual_information", "smallest_component_stddev",
// "largest_component_stddev". Empty while there is no mixture.
std::map<std::string, double> MixtureFigures(const v1::EpochReport& epoch);

// Returns the curves as CSV with one figure a line, under the titles
//   phase,epoch,step,examples,term,value
// `examples` is "training", "held-out" or, for MixtureFigures, "mixture". Lines end in '\n'.
std::string CurvesCsv(std::span<const LearningPhase> phases);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_LEARNING_CURVES_H_
