#include "model/evaluation/metric_table.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "model/evaluation/gaussian_shares.h"

namespace maneuver::evaluation {
namespace {

struct MetricRow {
  std::string_view name;
  std::string_view unit;
  Better better;
  double ideal = 0.0;
};

// The metrics in the order of lists. Names are without "_6" (best of six), "_prior" (generic
// distributions) and the marks of baselines.
constexpr MetricRow kMetrics[] = {
    {"ade", "m", Better::kLower},
    {"min_ade", "m", Better::kLower},
    {"fde", "m", Better::kLower},
    {"min_fde", "m", Better::kLower},
    {"brier_fde", "m", Better::kLower},
    {"miss_rate", "share", Better::kLower},
    {"miss_rate_nuscenes", "share", Better::kLower},
    {"miss_rate_waymo", "share", Better::kLower},
    {"ade_medoid", "m", Better::kLower},
    {"min_ade_cover", "m", Better::kLower},
    {"fde_medoid", "m", Better::kLower},
    {"min_fde_cover", "m", Better::kLower},
    {"miss_rate_medoid", "share", Better::kLower},
    {"miss_rate_cover", "share", Better::kLower},
    {"ade_waymo", "m", Better::kLower},
    {"min_ade_waymo", "m", Better::kLower},
    {"fde_waymo", "m", Better::kLower},
    {"min_fde_waymo", "m", Better::kLower},
    {"ade_ratio", "", Better::kLower},
    {"fde_ratio", "", Better::kLower},
    {"ade_medoid_ratio", "", Better::kLower},
    {"fde_medoid_ratio", "", Better::kLower},
    {"min_ade_6_ratio", "", Better::kLower},
    {"min_fde_6_ratio", "", Better::kLower},
    {"nll", "nats", Better::kLower},
    {"nll_joint", "nats", Better::kLower},
    {"nll_action", "nats", Better::kLower},
    {"coverage_1sigma", "share", Better::kNearer, kGaussianOneSigma},
    {"coverage_2sigma", "share", Better::kNearer, kGaussianTwoSigma},
    // From the latent's covariance alone, which is only a part of the whole, so none is better.
    {"coverage_1sigma_latent", "share", Better::kNone},
    {"coverage_2sigma_latent", "share", Better::kNone},
    {"mean_sigma_posterior", "m", Better::kNone},
    {"mean_sigma", "m", Better::kNone},  // with _prior
    {"mean_sigma_ratio", "", Better::kNone},
    {"effective_actions", "", Better::kNone},
    {"largest_share", "share", Better::kNone},
    {"action_perplexity", "", Better::kNone},
    {"action_entropy", "nats", Better::kNone},
    {"mutual_information", "nats", Better::kNone},
    {"calibration_error", "share", Better::kLower},
    {"nmi", "", Better::kHigher},
    {"purity", "share", Better::kHigher},
    {"nmi_kinematic", "", Better::kHigher},
    {"purity_kinematic", "share", Better::kHigher},
    {"class_information_kinematic", "share", Better::kHigher},
    {"nmi_relative", "", Better::kHigher},
    {"purity_relative", "share", Better::kHigher},
    {"class_information_relative", "share", Better::kHigher},
    {"named_share_relative", "share", Better::kHigher},
    {"named_share_motion", "share", Better::kHigher},
    {"labelled_examples", "", Better::kNone},
};

constexpr int kRanksOfOne = 1'000;  // more than any k

bool StripSuffix(std::string_view* name, std::string_view suffix) {
  if (!name->ends_with(suffix)) return false;
  name->remove_suffix(suffix.size());
  return true;
}

bool StripPrefix(std::string_view* name, std::string_view prefix) {
  if (!name->starts_with(prefix)) return false;
  name->remove_prefix(prefix.size());
  return true;
}

// Splits "min_ade_6" into "min_ade" and 6. Leaves a name without a number unchanged and returns 0.
int StripNumber(std::string_view* name) {
  const size_t underscore = name->rfind('_');
  if (underscore == std::string_view::npos) return 0;
  const std::string_view digits = name->substr(underscore + 1);
  if (digits.empty() || digits.size() > 2) return 0;
  int number = 0;
  for (const char c : digits) {
    if (c < '0' || c > '9') return 0;
    number = 10 * number + (c - '0');
  }
  name->remove_suffix(digits.size() + 1);
  return number;
}

// Returns how far a value is from the best possible one; infinity if it is not finite.
double Badness(const MetricInfo& metric, double value) {
  if (!std::isfinite(value)) return HUGE_VAL;
  if (metric.better == Better::kHigher) return -value;
  return metric.better == Better::kNearer ? std::abs(value - metric.ideal) : value;
}

}  // namespace

std::optional<MetricInfo> FindMetric(std::string_view name) {
  const bool trained = StripPrefix(&name, "covernet_") || StripPrefix(&name, "multipath_");
  const bool simple =
      StripSuffix(&name, "_cv") || StripSuffix(&name, "_ctra") || StripSuffix(&name, "_faded");
  const bool generic = StripSuffix(&name, "_prior");
  const int best_of = StripNumber(&name);
  const auto* const row = std::ranges::find(kMetrics, name, &MetricRow::name);
  if (row == std::end(kMetrics)) return std::nullopt;
  MetricInfo info{.unit = row->unit, .better = row->better, .ideal = row->ideal};
  info.of_model = !trained && !simple;
  if (!info.of_model) info.better = Better::kNone;
  // The model's own metrics come first, then its generic distributions, then baselines.
  constexpr int kRows = static_cast<int>(std::size(kMetrics));
  const int group = trained ? 3 : simple ? 2 : generic ? 1 : 0;
  info.rank =
      (group * kRows + static_cast<int>(row - std::begin(kMetrics))) * kRanksOfOne + best_of;
  return info;
}

bool CanDecide(std::string_view name) {
  const std::optional<MetricInfo> metric = FindMetric(name);
  return metric && metric->better != Better::kNone;
}

v1::MetricVerdict Judge(const MetricInfo& metric, double baseline, double candidate,
                        double tolerance) {
  if (metric.better == Better::kNone) return v1::METRIC_VERDICT_UNSPECIFIED;
  if (!std::isfinite(candidate)) return v1::METRIC_VERDICT_WORSE;
  const double before = Badness(metric, baseline);
  const double after = Badness(metric, candidate);
  if (after < before) return v1::METRIC_VERDICT_BETTER;
  return after <= before + tolerance ? v1::METRIC_VERDICT_NO_WORSE : v1::METRIC_VERDICT_WORSE;
}

}  // namespace maneuver::evaluation
