#include "model/evaluation/cross_validation_text.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/evaluation/metric_table.h"
#include "model/evaluation/rival_table.h"
#include "model/evaluation/rival_text.h"
#include "model/evaluation/text_block.h"

namespace maneuver::evaluation {
namespace {

std::string Number(double value) { return absl::StrFormat("%.3f", value); }

std::string IntervalText(const v1::Estimate& estimate) {
  return absl::StrFormat("%.3f .. %.3f", estimate.lower(), estimate.upper());
}

// Returns the value of each training seed; nothing for a single seed.
std::string SeedText(const google::protobuf::RepeatedField<double>& values) {
  if (values.size() < 2) return "";
  std::string text;
  for (const double value : values) absl::StrAppend(&text, text.empty() ? "" : "  ", Number(value));
  return text;
}

// Returns "ade_1, m", for example.
std::string LabelOf(const std::string& name) {
  const std::optional<MetricInfo> metric = FindMetric(name);
  if (!metric || metric->unit.empty()) return name;
  return absl::StrCat(name, ", ", std::string(metric->unit));
}

// Returns whether the table of all examples shows a metric. It shows the model's metrics of the
// most probable action and of the best six, and the average and final displacement of its rivals.
bool IsInTableOfAllExamples(const std::string& name) {
  const std::optional<MetricInfo> metric = FindMetric(name);
  if (!metric) return true;
  if (name.find("waymo") != name.npos || name.find("nuscenes") != name.npos) return false;
  if (!metric->of_model) {
    constexpr std::array<std::string_view, 4> kErrors = {"ade_1", "fde_1", "min_ade_6",
                                                         "min_fde_6"};
    const bool trained = std::ranges::any_of(kErrors, [&](std::string_view error) {
      return name == "covernet_" + std::string(error) || name == "multipath_" + std::string(error);
    });
    return trained || name.starts_with("ade_") || name.starts_with("fde_");
  }
  return !name.ends_with("_prior") && !name.ends_with("_5") && !name.ends_with("_10") &&
         !name.ends_with("_latent");
}

// Returns names in the order of metric_table.h; unknown names come last.
template <typename Value>
std::vector<std::string> Sorted(const google::protobuf::Map<std::string, Value>& metrics) {
  std::vector<std::pair<int, std::string>> ranked;
  for (const auto& [name, _] : metrics) {
    const std::optional<MetricInfo> metric = FindMetric(name);
    ranked.emplace_back(metric ? metric->rank : 1'000'000, name);
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<std::string> names;
  names.reserve(ranked.size());
  for (auto& [_, name] : ranked) names.push_back(std::move(name));
  return names;
}

Block MainMetrics(const v1::CrossValidatedSet& set) {
  Block block("ALL EXAMPLES", {"VALUE", "95 % INTERVAL", "OF EACH SEED"});
  for (const std::string& name : Sorted(set.overall().metrics())) {
    if (!IsInTableOfAllExamples(name)) continue;
    const v1::Estimate& estimate = set.overall().metrics().at(name);
    block.Add(LabelOf(name),
              {Number(estimate.value()), IntervalText(estimate), SeedText(estimate.seed_values())});
  }
  return block;
}

// Returns the metrics of each model that are not means over examples: the model's own, or those of
// the baselines that were trained with it.
Block ModelRanges(const v1::CrossValidatedSet& set, const std::string& title, bool of_model) {
  Block block(title, {"MEAN", "95 % INTERVAL", "RANGE OF MODELS", "OF EACH SEED"});
  for (const std::string& name : Sorted(set.set_metrics())) {
    const std::optional<MetricInfo> metric = FindMetric(name);
    if ((!metric || metric->of_model) != of_model) continue;
    const v1::ModelRange& range = set.set_metrics().at(name);
    const std::string interval =
        range.has_lower() ? absl::StrFormat("%.3f .. %.3f", range.lower(), range.upper()) : "-";
    block.Add(LabelOf(name), {Number(range.value()), interval,
                              absl::StrFormat("%.3f .. %.3f", range.smallest(), range.largest()),
                              SeedText(range.seed_values())});
  }
  return block;
}

constexpr std::array<std::string_view, 9> kStratumMetrics = {
    "ade_1",       "ade_ratio", "ade_medoid",      "min_ade_6",        "min_fde_6",
    "miss_rate_6", "nll",       "coverage_2sigma", "calibration_error"};

std::string Value(const v1::CrossValidatedPart& part, const std::string& name) {
  const auto found = part.metrics().find(name);
  return found == part.metrics().end() ? "" : Number(found->second.value());
}

Block Strata(const v1::CrossValidatedSet& set, const std::string& dimension,
             const std::string& title) {
  std::vector<std::string> titles = {"examples", "groups"};
  for (const std::string_view name : kStratumMetrics) titles.emplace_back(name);
  titles.emplace_back("ade_ratio, 95 %");
  Block block(title, titles);
  for (const v1::CrossValidatedPart& part : set.strata()) {
    if (part.dimension() != dimension) continue;
    std::vector<std::string> row = {absl::StrCat(part.examples()), absl::StrCat(part.groups())};
    for (const std::string_view name : kStratumMetrics) {
      row.push_back(Value(part, std::string(name)));
    }
    const auto ratio = part.metrics().find("ade_ratio");
    if (ratio != part.metrics().end()) row.push_back(IntervalText(ratio->second));
    block.Add(part.name(), std::move(row));
  }
  return block;
}

// Returns whether the set has several strata of a dimension, such as targets of several types.
bool HasSeveral(const v1::CrossValidatedSet& set, std::string_view dimension) {
  return std::ranges::count_if(set.strata(), [&](const v1::CrossValidatedPart& part) {
           return part.dimension() == dimension;
         }) > 1;
}

std::string VerdictText(const v1::RivalComparison& comparison) {
  return absl::StrFormat("%s %+.3f (%+.3f .. %+.3f)", VerdictMark(comparison.verdict()),
                         comparison.difference().value(), comparison.difference().lower(),
                         comparison.difference().upper());
}

// Returns the model's comparison with its rivals by one metric.
Block Comparisons(const v1::CrossValidatedSet& set, const std::string& metric) {
  std::vector<std::string> titles;
  titles.reserve(kRivals.size());
  for (const Rival& rival : kRivals) titles.emplace_back(rival.column);
  Block block(absl::StrCat("AHEAD BY ", metric, "?"), std::move(titles));
  const auto add = [&](const std::string& label, const v1::CrossValidatedPart& part) {
    std::vector<std::string> row(kRivals.size());
    bool any = false;
    for (const v1::RivalComparison& comparison : part.comparisons()) {
      if (comparison.metric() != metric) continue;
      const Rival* rival = FindRival(comparison.rival());
      if (rival == nullptr) continue;
      row[static_cast<size_t>(rival - kRivals.data())] = VerdictText(comparison);
      any = true;
    }
    if (any) block.Add(label, std::move(row));
  };
  add("all", set.overall());
  for (const v1::CrossValidatedPart& part : set.strata()) {
    if (part.dimension() == "speed" || part.dimension() == "class" ||
        part.dimension() == "dataset" || (part.dimension() == "type" && HasSeveral(set, "type"))) {
      add(part.name(), part);
    }
  }
  return block;
}

std::string Heading(const v1::CrossValidatedSet& set) {
  std::string text =
      set.name().empty() ? "HELD-OUT FOLDS" : absl::StrCat("TEST DATASET ", set.name());
  absl::StrAppend(&text, ": ", set.overall().examples(), " examples of ", set.recordings(),
                  " recordings in ", set.groups(), " groups, ", set.largest_group(),
                  " in the largest\n");
  if (set.left_out() > 0) {
    absl::StrAppend(&text, set.left_out(),
                    " more recordings were left out: they share a place or an agent with what the "
                    "models learned from\n");
  }
  if (set.groups() < kFewGroups) {
    absl::StrAppend(&text, "The intervals are of few groups: they are too narrow\n");
  }
  return text;
}

std::string SetText(const v1::CrossValidatedSet& set, bool color) {
  std::string text = Heading(set);
  std::vector<Block> blocks = {MainMetrics(set),
                               ModelRanges(set, "MEANING, OF EACH MODEL", /*of_model=*/true),
                               ModelRanges(set, "BASELINES, OF EACH MODEL", /*of_model=*/false),
                               Strata(set, "speed", "BY SPEED"), Strata(set, "class", "BY CLASS")};
  if (HasSeveral(set, "type")) blocks.push_back(Strata(set, "type", "BY TYPE"));
  blocks.push_back(Strata(set, "dataset", "BY DATASET"));
  for (const char* metric : {"ade_1", "fde_1", "ade_medoid", "min_ade_6", "min_fde_6", "nll"}) {
    blocks.push_back(Comparisons(set, metric));
  }
  for (const Block& block : blocks) {
    if (!block.empty()) absl::StrAppend(&text, "\n", block.Text(color));
  }
  return text;
}

}  // namespace

std::string CrossValidationText(const v1::CrossValidationReport& report, bool color) {
  std::string seeds;
  for (const int64_t seed : report.seeds()) {
    absl::StrAppend(&seeds, seeds.empty() ? "" : ", ", seed);
  }
  std::string text = absl::StrCat(
      report.folds(), " folds, training seed", report.seeds_size() == 1 ? " " : "s ", seeds, "; ",
      report.resamples(), " draws of groups of recordings for each interval\n");
  for (const v1::CrossValidatedSet& set : report.sets()) {
    absl::StrAppend(&text, "\n", SetText(set, color));
  }
  return text;
}

}  // namespace maneuver::evaluation
