// Prints a cross-validation for people.

#ifndef MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_TEXT_H_
#define MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_TEXT_H_

#include <string>

#include "maneuver/v1/cross_validation.pb.h"

namespace maneuver::evaluation {

// Returns tables for the held-out folds and for each test dataset: the main metrics with their
// intervals, what the actions of each model mean, the main metrics by speed and by kinematic class
// (by type and by dataset as well, if there are several), and which predictor is ahead in each. The
// report itself has all metrics and all strata. Lines end in '\n'. Without colour, the text is
// plain ASCII.
std::string CrossValidationText(const v1::CrossValidationReport& report, bool color);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_TEXT_H_
