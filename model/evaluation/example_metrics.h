// The metrics that are means over examples, by name. Reports and cross-validation average them.
// CONTRIBUTING.md, "Add a metric", has where a new one is named.

#ifndef MANEUVER_MODEL_EVALUATION_EXAMPLE_METRICS_H_
#define MANEUVER_MODEL_EVALUATION_EXAMPLE_METRICS_H_

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// A number for each example. The metric is its mean over the examples. evaluator.h defines the
// names.
struct ExampleMetric {
  std::string name;
  std::function<double(const Measurement& measured)> value;
};

// Returns the metrics that every measurement has, in a fixed order.
//   measured_by_waymo: whether the horizon reaches a time at which Waymo's benchmark measures.
//   with_baselines: whether covernet and multipath were measured too.
std::vector<ExampleMetric> ExampleMetrics(bool measured_by_waymo, bool with_baselines);

// A metric that is the ratio of the means of two example metrics.
struct MetricRatio {
  std::string_view name;
  std::string_view numerator;
  std::string_view denominator;
};

// Returns all ratios. A ratio has no value if its denominator is 0.
std::span<const MetricRatio> MetricRatios();

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_EXAMPLE_METRICS_H_
