// Prints the comparison of two versions for people.

#ifndef MANEUVER_CLIENT_CLI_COMPARISON_TEXT_H_
#define MANEUVER_CLIENT_CLI_COMPARISON_TEXT_H_

#include <string>

#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::cli {

// Returns a table. Each metric of the models has both values, the candidate's minus the baseline's,
// and the better version: "=" if they are equal, "within" if the candidate is worse by no more than
// its tolerance, empty if the metric has no better side. Shares are in percent. Metrics of the
// reports' baseline predictors are left out. Lines end in '\n'.
std::string ComparisonText(const v1::EvaluationComparison& comparison, bool color);

// Returns the same table for the main metrics of each stratum; empty without strata.
std::string StrataText(const v1::EvaluationComparison& comparison, bool color);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_COMPARISON_TEXT_H_
