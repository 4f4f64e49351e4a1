#include "model/evaluation/measured_set.h"

#include <string>
#include <vector>

#include "model/evaluation/example_metrics.h"
#include "model/evaluation/report.h"
#include "model/evaluation/strata.h"

namespace maneuver::evaluation {
namespace {

void AddDimensions(v1::MeasuredSet& set) {
  for (const Stratification& stratification : Stratifications()) {
    v1::StratumDimension& dimension = *set.add_dimensions();
    dimension.set_dimension(std::string(stratification.dimension));
    for (const std::string_view name : stratification.names) dimension.add_names(std::string(name));
  }
}

void AddRow(const data::Example& example, const Measurement& measured, int recording,
            std::span<const ExampleMetric> metrics, v1::MeasuredSet& set) {
  v1::MeasuredExample& row = *set.add_examples();
  row.set_recording(recording);
  row.set_target_id(example.target_id);
  row.set_time(example.time);
  for (const Stratification& stratification : Stratifications()) {
    row.add_strata(stratification.stratum(measured.keys));
  }
  for (const ExampleMetric& metric : metrics) row.add_values(metric.value(measured));
  Eigen::Index most_probable = 0;
  row.set_confidence(measured.probabilities.maxCoeff(&most_probable));
  row.set_responsibility(measured.responsibilities[most_probable]);
}

void AddSetMetrics(const MeasuredExamples& measured, std::span<const ExampleMetric> metrics,
                   v1::MeasuredSet& set) {
  auto& of_set = *set.mutable_set_metrics();
  of_set = MakeReport(measured.measured, measured.measured_by_waymo).metrics();
  for (const ExampleMetric& metric : metrics) of_set.erase(metric.name);
  for (const MetricRatio& ratio : MetricRatios()) of_set.erase(std::string(ratio.name));
}

}  // namespace

v1::MeasuredSet ToMeasuredSet(const MeasuredExamples& measured, std::span<const int> recordings) {
  const std::vector<ExampleMetric> metrics =
      ExampleMetrics(measured.measured_by_waymo, measured.measured.front().covernet.has_value());
  v1::MeasuredSet set;
  for (const ExampleMetric& metric : metrics) set.add_value_names(metric.name);
  AddDimensions(set);
  for (size_t i = 0; i < measured.examples.size(); ++i) {
    const data::Example& example = measured.examples[i];
    AddRow(example, measured.measured[i], recordings[static_cast<size_t>(example.recording)],
           metrics, set);
  }
  AddSetMetrics(measured, metrics, set);
  return set;
}

}  // namespace maneuver::evaluation
