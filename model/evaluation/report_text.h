// A report as people read it.

#ifndef MANEUVER_MODEL_EVALUATION_REPORT_TEXT_H_
#define MANEUVER_MODEL_EVALUATION_REPORT_TEXT_H_

#include <span>
#include <string>

#include "maneuver/v1/training_service.pb.h"

namespace maneuver::evaluation {

// Tables, one for each group of what the report holds: accuracy beside the baselines, likelihood
// and envelope, probabilities, actions and what they mean, strata, and where the model is ahead of
// its rivals (rival_text.h). What it does not hold is left out (a model's manifest has metrics and
// rivals alone); metrics that no table knows follow by name. Lines end in '\n'; without colour it
// is plain ASCII.
//   action_names: what to call the actions beside their ids, by id; may be empty
std::string ReportText(const v1::EvaluationReport& report, bool color,
                       std::span<const std::string> action_names = {});

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_REPORT_TEXT_H_
