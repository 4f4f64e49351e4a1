#include "model/evaluation/report.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/evaluation/anchor_report.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/clustering.h"

namespace maneuver::evaluation {
namespace {

using Metrics = google::protobuf::Map<std::string, double>;
using Part = std::vector<const Measurement*>;

// Writes means over some of the measurements.
class Means {
 public:
  Means(const Part& part, Metrics& metrics) : part_(part), metrics_(metrics) {}

  //   value: of a Measurement
  void Set(const std::string& name, auto value) const {
    double sum = 0.0;
    for (const Measurement* each : part_) sum += value(*each);
    metrics_[name] = sum / static_cast<double>(part_.size());
  }

 private:
  const Part& part_;
  Metrics& metrics_;
};

void SetRatio(Metrics& metrics, const std::string& name, const std::string& numerator,
              const std::string& denominator) {
  if (metrics.at(denominator) > 0.0) {
    metrics[name] = metrics.at(numerator) / metrics.at(denominator);
  }
}

// "ade" and 1: "ade_1", of which there is no smallest; "ade" and 6: "min_ade_6".
std::string Ranked(const std::string& error, int k) {
  return absl::StrCat(k == 1 ? "" : "min_", error, "_", k);
}

using Source = SourceMeasurement Measurement::*;
using Baseline = BaselineErrors Measurement::*;

// Errors of the best of k that are the same for everyone, and Argoverse 2's misses.
void SetDisplacement(const Means& means, Source source, size_t rank, const std::string& suffix) {
  const int k = kRanks[rank];
  const auto of = [&](auto field) {
    return [=](const Measurement& m) {
      return static_cast<double>((m.*source).displacement[rank].*field);
    };
  };
  means.Set(Ranked("ade", k) + suffix, of(&DisplacementErrors::min_ade));
  means.Set(Ranked("fde", k) + suffix, of(&DisplacementErrors::min_fde));
  means.Set(absl::StrCat("miss_rate_", k, suffix), of(&DisplacementErrors::missed_argoverse));
}

// What else benchmarks define.
void SetBenchmarks(const Means& means, size_t rank, bool measured_by_waymo) {
  const int k = kRanks[rank];
  means.Set(absl::StrCat("brier_fde_", k),
            [=](const Measurement& m) { return m.posterior.displacement[rank].brier_fde; });
  means.Set(absl::StrCat("miss_rate_nuscenes_", k),
            [=](const Measurement& m) { return m.posterior.displacement[rank].missed_nuscenes; });
  if (!measured_by_waymo) return;
  means.Set(Ranked("ade_waymo", k), [=](const Measurement& m) { return m.waymo[rank].min_ade; });
  means.Set(Ranked("fde_waymo", k), [=](const Measurement& m) { return m.waymo[rank].min_fde; });
  means.Set(absl::StrCat("miss_rate_waymo_", k),
            [=](const Measurement& m) { return m.waymo[rank].miss_rate; });
}

void SetBaseline(const Means& means, Baseline baseline, const std::string& suffix) {
  const auto of = [&](auto field) {
    return [=](const Measurement& m) {
      return static_cast<double>((m.*baseline).displacement.*field);
    };
  };
  means.Set("ade" + suffix, of(&DisplacementErrors::min_ade));
  means.Set("fde" + suffix, of(&DisplacementErrors::min_fde));
  means.Set("miss_rate" + suffix, of(&DisplacementErrors::missed_argoverse));
  means.Set("miss_rate_nuscenes" + suffix, of(&DisplacementErrors::missed_nuscenes));
}

void SetWaymoBaseline(const Means& means, Baseline baseline, const std::string& suffix) {
  const auto of = [&](auto field) {
    return [=](const Measurement& m) { return (m.*baseline).waymo.*field; };
  };
  means.Set("ade_waymo" + suffix, of(&WaymoErrors::min_ade));
  means.Set("fde_waymo" + suffix, of(&WaymoErrors::min_fde));
  means.Set("miss_rate_waymo" + suffix, of(&WaymoErrors::miss_rate));
}

// Likelihood and envelope.
void SetDensity(const Means& means, Source source, const std::string& suffix) {
  const auto set = [&](const std::string& name, auto value) {
    means.Set(name + suffix, [=](const Measurement& m) { return value(m.*source); });
  };
  set("nll", [](const SourceMeasurement& s) { return s.nll.marginal; });
  set("nll_joint", [](const SourceMeasurement& s) { return s.nll.joint; });
  set("nll_action", [](const SourceMeasurement& s) { return s.action_nll; });
  set("coverage_1sigma", [](const SourceMeasurement& s) { return s.envelope.whole.one_sigma; });
  set("coverage_2sigma", [](const SourceMeasurement& s) { return s.envelope.whole.two_sigma; });
  set("coverage_1sigma_latent",
      [](const SourceMeasurement& s) { return s.envelope.latent.one_sigma; });
  set("coverage_2sigma_latent",
      [](const SourceMeasurement& s) { return s.envelope.latent.two_sigma; });
}

ActionStatistics StatisticsOf(const Part& part) {
  ActionStatistics statistics(static_cast<int>(part.front()->probabilities.size()));
  for (const Measurement* each : part) statistics.Add(each->probabilities, each->responsibilities);
  return statistics;
}

void SetActions(const ActionStatistics& statistics, Metrics& metrics) {
  metrics["effective_actions"] = statistics.EffectiveActions();
  metrics["largest_share"] = statistics.MeanProbability().maxCoeff();
  metrics["action_perplexity"] = statistics.Perplexity();
  metrics["action_entropy"] = statistics.MeanEntropy();
  metrics["mutual_information"] = statistics.MutualInformation();
  metrics["calibration_error"] = statistics.ExpectedCalibrationError();
}

void SetAgreement(const Part& part, Metrics& metrics) {
  ContingencyTable maneuvers;
  ContingencyTable kinematic;
  for (const Measurement* each : part) {
    if (each->maneuver) maneuvers.Add(each->action, *each->maneuver);
    kinematic.Add(each->action, static_cast<int>(each->keys.kinematic_class));
  }
  metrics["nmi_kinematic"] = kinematic.NormalizedMutualInformation();
  metrics["purity_kinematic"] = kinematic.Purity();
  if (maneuvers.total() == 0) return;
  metrics["nmi"] = maneuvers.NormalizedMutualInformation();
  metrics["purity"] = maneuvers.Purity();
  metrics["labelled_examples"] = static_cast<double>(maneuvers.total());
}

void SetAll(const Part& part, bool measured_by_waymo, Metrics& metrics) {
  const Means means(part, metrics);
  for (size_t rank = 0; rank < kRanks.size(); ++rank) {
    SetDisplacement(means, &Measurement::posterior, rank, "");
    SetDisplacement(means, &Measurement::prior, rank, "_prior");
    SetBenchmarks(means, rank, measured_by_waymo);
  }
  SetBaseline(means, &Measurement::constant_velocity, "_cv");
  SetBaseline(means, &Measurement::constant_turn, "_ctra");
  if (measured_by_waymo) {
    SetWaymoBaseline(means, &Measurement::constant_velocity, "_cv");
    SetWaymoBaseline(means, &Measurement::constant_turn, "_ctra");
  }
  SetRatio(metrics, "ade_ratio", "ade_1", "ade_cv");
  SetRatio(metrics, "fde_ratio", "fde_1", "fde_cv");
  SetRatio(metrics, "min_ade_6_ratio", "min_ade_6", "ade_cv");
  SetRatio(metrics, "min_fde_6_ratio", "min_fde_6", "fde_cv");
  SetDensity(means, &Measurement::posterior, "");
  SetDensity(means, &Measurement::prior, "_prior");
  means.Set("mean_sigma_posterior",
            [](const Measurement& m) { return m.posterior.envelope.mean_sigma; });
  means.Set("mean_sigma_prior", [](const Measurement& m) { return m.prior.envelope.mean_sigma; });
  SetRatio(metrics, "mean_sigma_ratio", "mean_sigma_posterior", "mean_sigma_prior");
  SetAgreement(part, metrics);
}

// What is worth knowing of each stratum.
void SetMain(const Part& part, Metrics& metrics) {
  const Means means(part, metrics);
  Metrics all;
  const Means gather(part, all);
  for (size_t rank = 0; rank < kRanks.size(); ++rank) {
    SetDisplacement(gather, &Measurement::posterior, rank, "");
  }
  SetBaseline(gather, &Measurement::constant_velocity, "_cv");
  SetBaseline(gather, &Measurement::constant_turn, "_ctra");
  SetDensity(gather, &Measurement::posterior, "");
  SetDensity(gather, &Measurement::prior, "_prior");
  SetActions(StatisticsOf(part), all);
  for (const char* name : {"ade_1", "fde_1", "min_ade_6", "min_fde_6", "miss_rate_6", "ade_cv",
                           "fde_cv", "ade_ctra", "fde_ctra", "nll", "nll_prior", "coverage_1sigma",
                           "coverage_2sigma", "calibration_error"}) {
    metrics[name] = all.at(name);
  }
}

void AddStrata(std::span<const Measurement> measured, v1::EvaluationReport& report) {
  for (const Stratification& stratification : Stratifications()) {
    std::vector<Part> parts(stratification.names.size());
    for (const Measurement& each : measured) {
      parts[static_cast<size_t>(stratification.stratum(each.keys))].push_back(&each);
    }
    for (size_t i = 0; i < parts.size(); ++i) {
      v1::EvaluationStratum& stratum = *report.add_strata();
      stratum.set_dimension(std::string(stratification.dimension));
      stratum.set_name(std::string(stratification.names[i]));
      stratum.set_examples(static_cast<int64_t>(parts[i].size()));
      if (!parts[i].empty()) SetMain(parts[i], *stratum.mutable_metrics());
    }
  }
}

void AddReliability(const ActionStatistics& statistics, v1::EvaluationReport& report) {
  for (int i = 0; i < ActionStatistics::kBins; ++i) {
    const ActionStatistics::Bin& bin = statistics.bins()[static_cast<size_t>(i)];
    v1::ReliabilityBin& proto = *report.add_reliability();
    proto.set_lower(static_cast<double>(i) / ActionStatistics::kBins);
    proto.set_upper(static_cast<double>(i + 1) / ActionStatistics::kBins);
    proto.set_examples(bin.examples);
    if (bin.examples == 0) continue;
    proto.set_mean_confidence(bin.confidence / static_cast<double>(bin.examples));
    proto.set_mean_responsibility(bin.responsibility / static_cast<double>(bin.examples));
  }
}

void AddActionUses(std::span<const Measurement> measured, const ActionStatistics& statistics,
                   v1::EvaluationReport& report) {
  const Eigen::VectorXd probabilities = statistics.MeanProbability();
  std::vector<std::map<KinematicClass, int64_t>> classes(static_cast<size_t>(probabilities.size()));
  for (const Measurement& each : measured) {
    ++classes[static_cast<size_t>(each.action)][each.keys.kinematic_class];
  }
  for (size_t action = 0; action < classes.size(); ++action) {
    v1::ActionUse& use = *report.add_action_uses();
    use.set_probability(probabilities[static_cast<Eigen::Index>(action)]);
    use.set_largest_probability(statistics.LargestProbability()[static_cast<Eigen::Index>(action)]);
    if (classes[action].empty()) continue;
    int64_t examples = 0;
    for (const auto& [_, count] : classes[action]) examples += count;
    const auto& [most, count] =
        *std::max_element(classes[action].begin(), classes[action].end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; });
    use.set_examples(examples);
    use.set_kinematic_class(std::string(Name(most)));
    use.set_class_share(static_cast<double>(count) / static_cast<double>(examples));
  }
}

}  // namespace

v1::EvaluationReport MakeReport(std::span<const Measurement> measured, bool measured_by_waymo) {
  v1::EvaluationReport report;
  report.set_examples(static_cast<int64_t>(measured.size()));
  Part all;
  for (const Measurement& each : measured) all.push_back(&each);
  SetAll(all, measured_by_waymo, *report.mutable_metrics());
  const ActionStatistics statistics = StatisticsOf(all);
  SetActions(statistics, *report.mutable_metrics());
  const Eigen::VectorXd usage = statistics.MeanProbability();
  report.mutable_action_usage()->Add(usage.begin(), usage.end());
  AddReliability(statistics, report);
  AddStrata(measured, report);
  AddActionUses(measured, statistics, report);
  AddAnchorMetrics(measured, measured_by_waymo, report);
  return report;
}

}  // namespace maneuver::evaluation
