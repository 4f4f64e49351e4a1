#include "server/serving/serving_table_metrics.h"

#include <array>
#include <string_view>

namespace maneuver::serving {
namespace {

using security::kCandidateAlias;
using security::kServingAlias;
using security::ModelAliasName;

// Models that are labels: the first so many that had an alias.
constexpr size_t kMostModels = 32;
constexpr std::array<std::string_view, 2> kShownAliases = {kServingAlias, kCandidateAlias};

monitoring::Counter& SwapCounter(monitoring::MetricRegistry& registry, std::string alias) {
  return registry.AddCounter("maneuver_model_swaps_total",
                             "Times that an alias of a model was pointed to another version.",
                             {{"alias", std::move(alias)}});
}

}  // namespace

ServingTableMetrics::ServingTableMetrics(monitoring::MetricRegistry& registry, bool serves)
    : registry_(registry),
      loaded_(registry.AddGauge("maneuver_models_loaded", "Model versions that are in memory.")),
      load_time_(registry.AddHistogram("maneuver_model_load_seconds",
                                       "Time to load and warm up a model version.",
                                       monitoring::TimeBuckets())),
      failed_loads_(registry.AddCounter("maneuver_model_load_failures_total",
                                        "Model versions that could not be loaded, or did not "
                                        "survive the warm-up.")),
      serving_models_(
          serves ? &registry.AddGauge("maneuver_serving_models",
                                      "Models whose serving version is in memory; with none of "
                                      "them the server is not ready.")
                 : nullptr) {
  for (const std::string_view alias : kShownAliases) {
    swaps_[std::string(alias)] = &SwapCounter(registry, std::string(alias));
  }
  swaps_[""] = &SwapCounter(registry, "other");
}

void ServingTableMetrics::CountSwap(const std::string& alias) {
  const auto found = swaps_.find(alias);
  (found == swaps_.end() ? swaps_.at("") : found->second)->Increment();
}

void ServingTableMetrics::Show(const std::map<ModelAliasName, int>& aliases) {
  int serving = 0;
  for (const auto& [name, version] : aliases) {
    if (name.alias == kServingAlias) ++serving;
    if (models_.size() == kMostModels || !models_.insert(name.model).second) continue;
    for (const std::string_view alias : kShownAliases) {
      versions_[{name.model, std::string(alias)}] =
          &registry_.AddGauge("maneuver_model_version",
                              "Version in memory that an alias of a model points to; 0: none.",
                              {{"model", name.model}, {"alias", std::string(alias)}});
    }
  }
  if (serving_models_ != nullptr) serving_models_->Set(serving);
  for (const auto& [name, gauge] : versions_) {
    const auto found = aliases.find(name);
    gauge->Set(found == aliases.end() ? 0 : found->second);
  }
}

}  // namespace maneuver::serving
