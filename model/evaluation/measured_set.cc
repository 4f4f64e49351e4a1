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

using Metrics = google::protobuf::Map<std::string, double>;

Metrics MetricsOf(const SetSums& sums) {
  v1::EvaluationReport report;
  for (Eigen::Index i = 0; i < sums.actions().MeanProbability().size(); ++i) {
    report.add_action_uses();
  }
  sums.Write(report);
  return report.metrics();
}

constexpr int kBlocks = 100;

// Returns the sums of all blocks but one, for each block in order.
std::vector<SetSums> WithoutEach(const std::map<int, SetSums>& blocks) {
  std::vector<SetSums> without(blocks.size());
  SetSums before;
  size_t i = 0;
  for (const auto& [_, sums] : blocks) {
    without[i++].Add(before);
    before.Add(sums);
  }
  SetSums after;
  for (auto block = blocks.rbegin(); block != blocks.rend(); ++block) {
    without[--i].Add(after);
    after.Add(block->second);
  }
  return without;
}

}  // namespace

void MeasuredSetBuilder::Begin(const MeasuredExamples& block) {
  metrics_ = ExampleMetrics(block.measured_by_waymo, block.measured.front().covernet.has_value());
  for (const ExampleMetric& metric : metrics_) set_.add_value_names(metric.name);
  AddDimensions(set_);
}

void MeasuredSetBuilder::Add(const MeasuredExamples& block, std::span<const int> recordings) {
  for (size_t i = 0; i < block.examples.size(); ++i) {
    if (sums_.empty()) Begin(block);
    const data::Example& example = block.examples[i];
    const int recording = recordings[static_cast<size_t>(example.recording)];
    sums_[groups_[static_cast<size_t>(recording)] % kBlocks].Add(block.measured[i]);
    AddRow(example, block.measured[i], recording, metrics_, set_);
  }
}

v1::MeasuredSet MeasuredSetBuilder::Build() && {
  SetSums all;
  for (const auto& [_, sums] : sums_) all.Add(sums);
  *set_.mutable_set_metrics() = MetricsOf(all);
  const std::vector<SetSums> without = WithoutEach(sums_);
  size_t i = 0;
  for (const auto& [block, _] : sums_) {
    const SetSums& rest = without[i++];
    v1::SetWithoutBlock& left = *set_.add_without();
    left.set_block(block);
    left.set_examples(rest.examples());
    if (rest.examples() > 0) *left.mutable_set_metrics() = MetricsOf(rest);
  }
  return std::move(set_);
}

}  // namespace maneuver::evaluation
