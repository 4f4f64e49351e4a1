// Two versions side by side, as people read it.

#ifndef MANEUVER_CLIENT_CLI_COMPARISON_TEXT_H_
#define MANEUVER_CLIENT_CLI_COMPARISON_TEXT_H_

#include <string>

#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::cli {

// A table: each metric of the models with both values, the candidate's less the baseline's, and
// which is better ("=" if they are equal, empty if the metric has no better side; "within" if the
// candidate is worse by no more than its tolerance). Shares are percent. What baselines of the
// reports measured is left out: it says nothing of the versions. Lines end in '\n'.
std::string ComparisonText(const v1::EvaluationComparison& comparison, bool color);

// Likewise the main metrics of each part of the examples; empty without any.
std::string StrataText(const v1::EvaluationComparison& comparison, bool color);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_COMPARISON_TEXT_H_
