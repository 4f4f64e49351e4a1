// The figures of a cross-validation: means over all examples, intervals, and which predictor is
// ahead.

#ifndef MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_REPORT_H_

#include "maneuver/v1/cross_validation.pb.h"
#include "model/evaluation/grouped_sums.h"

namespace maneuver::evaluation {

// Returns the figures of a whole cross-validation, as MergeParts returns it. For each training
// seed, a figure is computed from the examples of all folds together; the estimate is the mean over
// the seeds. The bootstrap draws groups of recordings; all figures of a set share the same draws:
//   means              sum of the values / number of examples
//   ratios             of two means (MetricRatios)
//   differences        of two means over the same examples
//   calibration_error  as in ActionStatistics, from the examples of all folds together; its
//                      interval is by the jackknife (EstimateByJackknife)
// Other metrics of whole sets (mutual_information, nmi, ...) are measured for each model on its
// set, and averaged: nmi and purity by labelled examples, the others by all. They have the range
// over the models, and an interval by the jackknife over the same groups (bootstrap.h): drawing a
// group twice would make clusters and classes look more alike than they are.
v1::CrossValidationReport MakeCrossValidationReport(const v1::CrossValidationPart& whole,
                                                    const BootstrapOptions& options);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_REPORT_H_
