#include "model/evaluation/example_metrics.h"

#include <array>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"

namespace maneuver::evaluation {
namespace {

using Source = SourceMeasurement Measurement::*;
using Baseline = BaselineErrors Measurement::*;
using Anchors = std::optional<AnchorMeasurement> Measurement::*;

// Returns "ade_1" for "ade" and 1, which has no minimum, and "min_ade_6" for "ade" and 6.
std::string Ranked(const std::string& error, int k) {
  return absl::StrCat(k == 1 ? "" : "min_", error, "_", k);
}

class MetricList {
 public:
  void Add(std::string name, std::function<double(const Measurement&)> value) {
    metrics_.push_back({std::move(name), std::move(value)});
  }

  // Adds the errors of the best of k that all benchmarks share, and Argoverse 2's misses.
  void AddDisplacement(Source source, size_t rank, const std::string& suffix) {
    const int k = kRanks[rank];
    const auto of = [&](auto field) {
      return [=](const Measurement& m) {
        return static_cast<double>((m.*source).displacement[rank].*field);
      };
    };
    Add(Ranked("ade", k) + suffix, of(&DisplacementErrors::min_ade));
    Add(Ranked("fde", k) + suffix, of(&DisplacementErrors::min_fde));
    Add(absl::StrCat("miss_rate_", k, suffix), of(&DisplacementErrors::missed_argoverse));
  }

  // Adds the errors of the representatives. The first one alone is the medoid.
  void AddCover(size_t rank) {
    const int k = kRanks[rank];
    const auto of = [&](auto field) {
      return [=](const Measurement& m) { return static_cast<double>(m.cover[rank].*field); };
    };
    const auto name = [&](const std::string& error) {
      return k == 1 ? error + "_medoid" : absl::StrCat("min_", error, "_cover_", k);
    };
    Add(name("ade"), of(&DisplacementErrors::min_ade));
    Add(name("fde"), of(&DisplacementErrors::min_fde));
    Add(k == 1 ? "miss_rate_medoid" : absl::StrCat("miss_rate_cover_", k),
        of(&DisplacementErrors::missed_argoverse));
  }

  // Adds the other errors that benchmarks define.
  void AddBenchmarks(size_t rank, bool measured_by_waymo) {
    const int k = kRanks[rank];
    Add(absl::StrCat("brier_fde_", k),
        [=](const Measurement& m) { return m.posterior.displacement[rank].brier_fde; });
    Add(absl::StrCat("miss_rate_nuscenes_", k),
        [=](const Measurement& m) { return m.posterior.displacement[rank].missed_nuscenes; });
    if (!measured_by_waymo) return;
    Add(Ranked("ade_waymo", k), [=](const Measurement& m) { return m.waymo[rank].min_ade; });
    Add(Ranked("fde_waymo", k), [=](const Measurement& m) { return m.waymo[rank].min_fde; });
    Add(absl::StrCat("miss_rate_waymo_", k),
        [=](const Measurement& m) { return m.waymo[rank].miss_rate; });
  }

  void AddBaseline(Baseline baseline, bool measured_by_waymo, const std::string& suffix) {
    const auto of = [&](auto field) {
      return [=](const Measurement& m) {
        return static_cast<double>((m.*baseline).displacement.*field);
      };
    };
    Add("ade" + suffix, of(&DisplacementErrors::min_ade));
    Add("fde" + suffix, of(&DisplacementErrors::min_fde));
    Add("miss_rate" + suffix, of(&DisplacementErrors::missed_argoverse));
    Add("miss_rate_nuscenes" + suffix, of(&DisplacementErrors::missed_nuscenes));
    if (!measured_by_waymo) return;
    const auto of_waymo = [&](auto field) {
      return [=](const Measurement& m) { return (m.*baseline).waymo.*field; };
    };
    Add("ade_waymo" + suffix, of_waymo(&WaymoErrors::min_ade));
    Add("fde_waymo" + suffix, of_waymo(&WaymoErrors::min_fde));
    Add("miss_rate_waymo" + suffix, of_waymo(&WaymoErrors::miss_rate));
  }

  // Adds likelihood and envelope.
  void AddDensity(Source source, const std::string& suffix) {
    const auto add = [&](const std::string& name, auto value) {
      Add(name + suffix, [=](const Measurement& m) { return value(m.*source); });
    };
    add("nll", [](const SourceMeasurement& s) { return s.nll.marginal; });
    add("nll_joint", [](const SourceMeasurement& s) { return s.nll.joint; });
    add("nll_action", [](const SourceMeasurement& s) { return s.action_nll; });
    add("coverage_1sigma", [](const SourceMeasurement& s) { return s.envelope.whole.one_sigma; });
    add("coverage_2sigma", [](const SourceMeasurement& s) { return s.envelope.whole.two_sigma; });
    add("coverage_1sigma_latent",
        [](const SourceMeasurement& s) { return s.envelope.latent.one_sigma; });
    add("coverage_2sigma_latent",
        [](const SourceMeasurement& s) { return s.envelope.latent.two_sigma; });
  }

  void AddAnchors(Anchors anchors, const std::string& prefix, bool measured_by_waymo) {
    const auto add = [&](const std::string& name, auto value) {
      Add(prefix + name,
          [=](const Measurement& m) { return static_cast<double>(value(*(m.*anchors))); });
    };
    for (size_t rank = 0; rank < kRanks.size(); ++rank) {
      const int k = kRanks[rank];
      const auto of = [rank](auto error) {
        return [rank, error](const AnchorMeasurement& m) { return m.displacement[rank].*error; };
      };
      add(Ranked("ade", k), of(&DisplacementErrors::min_ade));
      add(Ranked("fde", k), of(&DisplacementErrors::min_fde));
      add(absl::StrCat("brier_fde_", k), of(&DisplacementErrors::brier_fde));
      add(absl::StrCat("miss_rate_", k), of(&DisplacementErrors::missed_argoverse));
      add(absl::StrCat("miss_rate_nuscenes_", k), of(&DisplacementErrors::missed_nuscenes));
      if (!measured_by_waymo) continue;
      add(absl::StrCat("miss_rate_waymo_", k),
          [rank](const AnchorMeasurement& m) { return m.waymo[rank].miss_rate; });
    }
    add("nll", [](const AnchorMeasurement& m) { return m.nll.marginal; });
    add("nll_joint", [](const AnchorMeasurement& m) { return m.nll.joint; });
  }

  std::vector<ExampleMetric> Take() && { return std::move(metrics_); }

 private:
  std::vector<ExampleMetric> metrics_;
};

constexpr std::array<MetricRatio, 7> kRatios = {{
    {"ade_ratio", "ade_1", "ade_cv"},
    {"fde_ratio", "fde_1", "fde_cv"},
    {"ade_medoid_ratio", "ade_medoid", "ade_cv"},
    {"fde_medoid_ratio", "fde_medoid", "fde_cv"},
    {"min_ade_6_ratio", "min_ade_6", "ade_cv"},
    {"min_fde_6_ratio", "min_fde_6", "fde_cv"},
    {"mean_sigma_ratio", "mean_sigma_posterior", "mean_sigma_prior"},
}};

}  // namespace

std::vector<ExampleMetric> ExampleMetrics(bool measured_by_waymo, bool with_baselines) {
  MetricList metrics;
  for (size_t rank = 0; rank < kRanks.size(); ++rank) {
    metrics.AddDisplacement(&Measurement::posterior, rank, "");
    metrics.AddDisplacement(&Measurement::prior, rank, "_prior");
    metrics.AddCover(rank);
    metrics.AddBenchmarks(rank, measured_by_waymo);
  }
  metrics.AddBaseline(&Measurement::constant_velocity, measured_by_waymo, "_cv");
  metrics.AddBaseline(&Measurement::constant_turn, measured_by_waymo, "_ctra");
  metrics.AddBaseline(&Measurement::faded, measured_by_waymo, "_faded");
  metrics.AddDensity(&Measurement::posterior, "");
  metrics.AddDensity(&Measurement::prior, "_prior");
  metrics.Add("mean_sigma_posterior",
              [](const Measurement& m) { return m.posterior.envelope.mean_sigma; });
  metrics.Add("mean_sigma_prior", [](const Measurement& m) { return m.prior.envelope.mean_sigma; });
  if (with_baselines) {
    metrics.AddAnchors(&Measurement::covernet, "covernet_", measured_by_waymo);
    metrics.AddAnchors(&Measurement::multipath, "multipath_", measured_by_waymo);
  }
  return std::move(metrics).Take();
}

std::span<const MetricRatio> MetricRatios() { return kRatios; }

}  // namespace maneuver::evaluation
