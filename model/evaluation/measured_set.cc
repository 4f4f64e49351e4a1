#include "model/evaluation/measured_set.h"

#include <string>
#include <utility>

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

}  // namespace

void MeasuredSetBuilder::Begin(const MeasuredExamples& block) {
  sums_.emplace(block.measured_by_waymo);
  metrics_ = ExampleMetrics(block.measured_by_waymo, block.measured.front().covernet.has_value());
  for (const ExampleMetric& metric : metrics_) set_.add_value_names(metric.name);
  AddDimensions(set_);
}

void MeasuredSetBuilder::Add(const MeasuredExamples& block, std::span<const int> recordings) {
  for (size_t i = 0; i < block.examples.size(); ++i) {
    if (!sums_) Begin(block);
    const data::Example& example = block.examples[i];
    sums_->Add(block.measured[i]);
    AddRow(example, block.measured[i], recordings[static_cast<size_t>(example.recording)], metrics_,
           set_);
  }
}

v1::MeasuredSet MeasuredSetBuilder::Build() && {
  auto& of_set = *set_.mutable_set_metrics();
  of_set = sums_->MakeReport().metrics();
  for (const ExampleMetric& metric : metrics_) of_set.erase(metric.name);
  for (const MetricRatio& ratio : MetricRatios()) of_set.erase(std::string(ratio.name));
  return std::move(set_);
}

}  // namespace maneuver::evaluation
