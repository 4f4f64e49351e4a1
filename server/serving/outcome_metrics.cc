#include "server/serving/outcome_metrics.h"

#include <algorithm>
#include <array>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/envelope.h"
#include "model/evaluation/input_ranges.h"

namespace maneuver::serving {
namespace {

constexpr char kOthers[] = "_others";  // no model can have this name
constexpr size_t kDisplacements = 4;   // the first of kOutcomeMetrics, metres
constexpr size_t kHistograms = 5;      // those and nll
constexpr std::array<const char*, 2> kSigmas = {"1", "2"};
constexpr size_t kConfidenceBins = evaluation::ActionStatistics::kBins;
static_assert(kConfidenceBins == 10, "labels have one decimal");

monitoring::Counter& ReportedTargets(monitoring::MetricRegistry& metrics, const char* result) {
  return metrics.AddCounter(
      "maneuver_outcome_targets_total",
      "Targets whose outcomes were reported: scored; unknown, because their answer or model is not "
      "kept; invalid; failed through a fault of the model or the server.",
      {{"result", result}});
}

monitoring::Histogram& MetricHistogram(monitoring::MetricRegistry& metrics, size_t metric,
                                       const monitoring::Labels& labels) {
  if (metric >= kDisplacements) {
    return metrics.AddHistogram(
        "maneuver_outcome_nll_nats",
        "-ln p(x|s) of what targets did, under the mixture of all actions, nats a waypoint.",
        {-3, -2, -1, 0, 1, 2, 3, 5, 10, 30, 100}, labels);
  }
  monitoring::Labels with_measure = labels;
  with_measure["measure"] = std::string(kOutcomeMetrics[metric]);
  return metrics.AddHistogram(
      "maneuver_outcome_displacement_meters",
      "Distance of predictions from what targets did, on average and at the horizon: of the "
      "likeliest action (ade_1, fde_1) and of the best of six (min_ade_6, min_fde_6).",
      {0.1, 0.3, 0.5, 1, 2, 3, 5, 10, 30, 100}, with_measure);
}

void ShowExpectedCoverage(const v1::ModelManifest& manifest, const std::string& version,
                          monitoring::MetricRegistry& metrics) {
  constexpr std::array kGaussian = {evaluation::kGaussianOneSigma, evaluation::kGaussianTwoSigma};
  for (size_t i = 0; i < kSigmas.size(); ++i) {
    const auto found = manifest.metrics().find(std::string(kOutcomeMetrics[kHistograms + i]));
    metrics
        .AddGauge("maneuver_outcome_expected_coverage_ratio",
                  "Share of the waypoints within 1 and 2 sigma in the model's validation; of a "
                  "Gaussian, if the model does not say.",
                  {{"model_version", version}, {"sigma", kSigmas[i]}})
        .Set(found == manifest.metrics().end() ? kGaussian[i] : found->second);
  }
}

}  // namespace

OutcomeMetrics::Stratum::Stratum(monitoring::MetricRegistry& metrics, const std::string& version,
                                 const std::string& speed)
    : outcomes(metrics.AddCounter("maneuver_outcome_scored_total",
                                  "Predictions that were scored against what happened.",
                                  {{"model_version", version}, {"speed", speed}})) {
  const monitoring::Labels labels = {{"model_version", version}, {"speed", speed}};
  for (size_t metric = 0; metric < kHistograms; ++metric) {
    histograms.push_back(&MetricHistogram(metrics, metric, labels));
  }
  for (const char* sigma : kSigmas) {
    monitoring::Labels with_sigma = labels;
    with_sigma["sigma"] = sigma;
    covered.push_back(&metrics.AddCounter(
        "maneuver_outcome_covered_total",
        "Sum over outcomes of the share of waypoints within 1 and 2 sigma of the action taken.",
        with_sigma));
  }
}

OutcomeMetrics::ConfidenceBin::ConfidenceBin(monitoring::MetricRegistry& metrics,
                                             const std::string& version, size_t bin)
    : outcomes(metrics.AddCounter(
          "maneuver_outcome_likeliest_total",
          "Outcomes by p(y|s) of the likeliest action: the lower end of a tenth.",
          {{"model_version", version}, {"probability", absl::StrCat("0.", bin)}})),
      probability(metrics.AddCounter(
          "maneuver_outcome_likeliest_probability_total",
          "Sum over these outcomes of p(y|s) of the likeliest action.",
          {{"model_version", version}, {"probability", absl::StrCat("0.", bin)}})),
      responsibility(metrics.AddCounter(
          "maneuver_outcome_likeliest_responsibility_total",
          "Sum over these outcomes of q(y|x,s) of the likeliest action: how often it was taken.",
          {{"model_version", version}, {"probability", absl::StrCat("0.", bin)}})) {}

OutcomeMetrics::OutcomeMetrics(monitoring::MetricRegistry& metrics)
    : metrics_(metrics),
      scored_(ReportedTargets(metrics, "scored")),
      unknown_(ReportedTargets(metrics, "unknown")),
      invalid_(ReportedTargets(metrics, "invalid")),
      failed_(ReportedTargets(metrics, "failed")) {}

OutcomeMetrics::Version& OutcomeMetrics::VersionOf(const ServedModel& model) {
  std::string label = absl::StrCat(model.name().model, "/", model.name().version);
  if (!versions_.contains(label) && versions_.size() >= kMostVersions) label = kOthers;
  const auto [found, added] = versions_.try_emplace(label);
  Version& version = found->second;
  version.label = label;
  if (!added) return version;
  for (size_t bin = 0; bin < kConfidenceBins; ++bin) {
    version.confidence.emplace_back(metrics_, label, bin);
  }
  if (label == kOthers) return version;
  const v1::ModelManifest& manifest = model.model().manifest();
  ShowExpectedCoverage(manifest, label, metrics_);
  if (!manifest.input_ranges().empty()) {
    for (const evaluation::InputFigure& figure : evaluation::InputFigures()) {
      version.outside.push_back(&metrics_.AddCounter(
          "maneuver_outcome_outside_training_total",
          "Outcomes whose input lies outside of what the model was trained on: the target's speed, "
          "the number of agents, or the map features within 50 m of the target.",
          {{"input", std::string(figure.name)}, {"model_version", label}}));
    }
  }
  for (int k = 0; k < manifest.spec().actions(); ++k) {
    const monitoring::Labels labels = {{"action", absl::StrCat(k)}, {"model_version", label}};
    version.actions.push_back(&metrics_.AddCounter(
        "maneuver_outcome_action_probability_total",
        "Sum over outcomes of p(y|s): how many targets were expected to take each action.",
        labels));
    if (k >= manifest.actions_size()) continue;
    metrics_
        .AddGauge("maneuver_outcome_expected_action_ratio",
                  "Share of each action in the model's validation: its mean p(y|s).", labels)
        .Set(manifest.actions(k).usage());
  }
  return version;
}

void OutcomeMetrics::Observe(const ServedModel& model, const ScoredOutcome& outcome) {
  scored_.Increment();
  const MutexLock lock(mutex_);
  Version& version = VersionOf(model);
  const auto [found, added] = version.strata.try_emplace(
      outcome.speed_stratum, metrics_, version.label, std::string(outcome.speed_stratum));
  const Stratum& stratum = found->second;
  stratum.outcomes.Increment();
  for (size_t i = 0; i < kHistograms; ++i) stratum.histograms[i]->Observe(outcome.metrics[i]);
  for (size_t i = 0; i < kSigmas.size(); ++i) {
    stratum.covered[i]->Increment(outcome.metrics[kHistograms + i]);
  }
  Eigen::Index likeliest = 0;
  const double confidence = outcome.measurement.probabilities.maxCoeff(&likeliest);
  const auto bin = static_cast<size_t>(std::max(0.0, confidence * kConfidenceBins));
  const ConfidenceBin& reliability = version.confidence[std::min(bin, kConfidenceBins - 1)];
  reliability.outcomes.Increment();
  reliability.probability.Increment(confidence);
  reliability.responsibility.Increment(outcome.measurement.responsibilities[likeliest]);
  for (size_t i = 0; i < version.outside.size(); ++i) {
    if (evaluation::IsOutside(evaluation::InputFigures()[i], outcome.measurement.keys,
                              model.model().manifest().input_ranges())) {
      version.outside[i]->Increment();
    }
  }
  for (size_t k = 0; k < version.actions.size(); ++k) {
    version.actions[k]->Increment(outcome.measurement.probabilities[static_cast<Eigen::Index>(k)]);
  }
}

void OutcomeMetrics::CountFailed(const absl::Status& status) {
  if (absl::IsNotFound(status) || absl::IsFailedPrecondition(status)) {
    unknown_.Increment();
  } else if (absl::IsInvalidArgument(status)) {
    invalid_.Increment();
  } else {
    failed_.Increment();
  }
}

}  // namespace maneuver::serving
