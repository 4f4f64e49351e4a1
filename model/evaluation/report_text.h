// Prints a report for people.

#ifndef MANEUVER_MODEL_EVALUATION_REPORT_TEXT_H_
#define MANEUVER_MODEL_EVALUATION_REPORT_TEXT_H_

#include <span>
#include <string>

#include "maneuver/v1/training_service.pb.h"

namespace maneuver::evaluation {

// Returns one table for each group of metrics: accuracy beside the baselines that learn nothing and
// beside the trained ones, likelihood and envelope, probabilities, actions and what they mean, and
// strata; then the metrics that no table shows, by name, and where the model is ahead of its rivals
// (rival_text.h). Leaves out what the report lacks: one from a model's manifest has only metrics
// and rivals. If an evaluation has no trained baselines, the last lines say how to add them. Lines
// end in '\n'. Without colour, the text is plain ASCII.
//   action_names: what to call the actions beside their ids, by id; may be empty
std::string ReportText(const v1::EvaluationReport& report, bool color,
                       std::span<const std::string> action_names = {});

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_REPORT_TEXT_H_
